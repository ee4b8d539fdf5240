"""One object as bytes: columns, codecs, rows, shards, and the manifest that lists them."""
