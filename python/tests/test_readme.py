"""The Python in the README runs as it is written there, block after block, in a folder that looks like a clone."""

import os
import pathlib
import re
import subprocess
import sys

import numpy as np

ROOT = pathlib.Path(__file__).resolve().parents[2]


def blocks(language):
    """The blocks of the README in a language."""
    return re.findall(rf"^```{language}\n(.*?)^```", (ROOT / "README.md").read_text(), re.MULTILINE | re.DOTALL)


def test_every_block_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    os.symlink(ROOT / "models", tmp_path / "models")
    # The README makes this one with the command line.
    np.savez("ant.npz", qpos=np.zeros((256, 500, 15)))
    names = {}
    found = blocks("python")
    assert len(found) >= 3
    for block in found:
        exec(compile(block, "README.md", "exec"), names)
    assert np.load("controls.npz")["ctrl"].shape == (256, 500, 8)
    assert names["qpos"].shape == (256, 500, 15)
    assert names["state"].shape[:2] == (256, 100)


def test_the_example_runs():
    lines = [line for block in blocks("sh") for line in block.splitlines() if line.startswith("venv/bin/python ")]
    assert lines
    for line in lines:
        subprocess.run([sys.executable, *line.split()[1:]], cwd=ROOT, check=True, timeout=300, capture_output=True)
