"""The web app of the benchmark as a Hugging Face Space; README.md says how to set it up."""

import os
from pathlib import Path

from xden1k.access.hub import data_root
from xden1k.folder import open_folder
from xden_bench.scoring.reference import Reference
from xden_bench.serve.site import Site, run, take_address

if __name__ == "__main__":
    kept = Path(os.environ.get("XDEN_DESK", "/data"))
    truth = Reference(open_folder(data_root()), "test")
    site = Site(truth, kept / "results", kept / "state", login=True)
    with take_address("0.0.0.0", 7860) as listener:  # noqa: S104 - a Space is its own network
        run(site, listener, print)
