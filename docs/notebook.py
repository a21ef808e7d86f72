"""Run docs/notebook.ipynb in a fresh kernel and store its outputs.

Usage: python docs/notebook.py
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import nbformat
from nbclient import NotebookClient

FILE = Path(__file__).with_suffix('.ipynb')
TIMEOUT = 600  # s for a cell: the first compiles what `make setup` did not


def executed(file: Path = FILE) -> Any:
    """The notebook with new outputs, from the root of the checkout."""
    notebook = nbformat.read(file, as_version=4)
    place = {'metadata': {'path': str(FILE.parents[1])}}
    NotebookClient(notebook, timeout=TIMEOUT, resources=place, record_timing=False).execute()
    notebook.metadata = {key: notebook.metadata[key] for key in ('kernelspec',)}
    return notebook


if __name__ == '__main__':
    nbformat.write(executed(), FILE)
