"""The notebook of the documentation runs, and shows what it gives."""

import importlib.util
import json
import re
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[1] / 'docs'
LARGEST = 100_000  # characters of an output


def stored():
    """Outputs in the file: for each cell its texts by kind."""
    return outputs(json.loads((DOCS / 'notebook.ipynb').read_text()))


def outputs(notebook):
    """Outputs of a notebook: for each cell its texts by kind."""
    found = []
    for cell in notebook['cells']:
        for output in cell.get('outputs', []):
            data = {**output.get('data', {}), output.get('name', 'text'): output.get('text', '')}
            found.append({kind: ''.join(text) for kind, text in data.items() if text})
    return found


def test_its_outputs_are_small_and_of_no_machine():
    found = stored()
    assert any('image/png' in output for output in found)
    for output in found:
        for kind, text in output.items():
            assert len(text) < LARGEST, kind
            if kind != 'image/png':
                assert not re.search(r'/(home|root|tmp|work|usr|var)\b|\.py\b|0x[0-9a-f]{6}', text)
        assert 'stderr' not in output


@pytest.mark.endurance
def test_a_fresh_kernel_gives_the_outputs_that_are_shown():
    spec = importlib.util.spec_from_file_location('notebook_page', DOCS / 'notebook.py')
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    found = outputs(module.executed())
    assert [o.get('text/plain', o.get('stdout')) for o in found] == [
        o.get('text/plain', o.get('stdout')) for o in stored()
    ], 'run make docs'
