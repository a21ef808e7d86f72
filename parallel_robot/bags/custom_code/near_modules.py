"""Modules beside a bag: whoever made the bag may have put them there, and nobody is shown them."""

from __future__ import annotations

import ast
import os
import sys
import warnings
from collections.abc import Iterator, Mapping
from importlib.machinery import PathFinder
from pathlib import Path

from parallel_robot_model.common.errors import BagError

PATHS = 'PYTHONPATH'  # for the processes that are started


def refuse(bag: Path, texts: Mapping[str, str]) -> None:
    """Let code of a bag import nothing that lies beside the bag or in the current directory.

    The suite itself may lie there.

    Args:
        bag: The bag.
        texts: Its code by title, as Python.

    Raises:
        BagError: the code names such a module.
    """
    if not texts:
        return
    near = {Path.cwd().resolve(), bag.resolve(), bag.resolve().parent}
    near.discard(Path(__file__).resolve().parents[3])
    for title, text in texts.items():
        for module in _imported(text):
            found = _place(module)
            if found is not None and found.parent in near:
                raise BagError(
                    f'{bag}: {title.partition(",")[0]} imports {module} from {found}, which lies '
                    'beside the bag, not in it; a module that is installed can be imported'
                )
    sys.path[:] = [entry for entry in sys.path if Path(entry).resolve() not in near]
    if os.environ.get(PATHS):
        entries = os.environ[PATHS].split(os.pathsep)
        kept = [entry for entry in entries if Path(entry).resolve() not in near]
        os.environ[PATHS] = os.pathsep.join(kept)


def _imported(text: str) -> Iterator[str]:
    """Names of the outermost packages that code imports."""
    with warnings.catch_warnings():
        warnings.simplefilter('ignore')
        nodes = ast.walk(ast.parse(text))
    for node in nodes:
        if isinstance(node, ast.Import):
            yield from (alias.name.partition('.')[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            yield node.module.partition('.')[0]


def _place(module: str) -> Path | None:
    """File or folder of an outermost module."""
    if module in sys.builtin_module_names:
        return None
    found = PathFinder.find_spec(module)
    if found is None:
        return None
    for folder in found.submodule_search_locations or ():
        return Path(folder).resolve()
    return Path(found.origin).resolve() if found.origin else None
