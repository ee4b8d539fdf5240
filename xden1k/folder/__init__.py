"""A dataset folder: written whole or not at all, and read object by object."""

from xden1k.folder.place import exclusive
from xden1k.folder.reader import DatasetFolder, open_folder
from xden1k.folder.writer import (
    SHARD_BYTES,
    refuse_to_replace_others,
    write_folder,
    write_rows,
)

__all__ = [
    "SHARD_BYTES",
    "DatasetFolder",
    "exclusive",
    "open_folder",
    "refuse_to_replace_others",
    "write_folder",
    "write_rows",
]
