"""The examples run."""

from __future__ import annotations

import subprocess
import sys

import pytest
from conftest import ROOT

EXAMPLES = {
    "rollout.py": ["--quick"],
    "swing_up.py": ["--quick"],
    "throughput.py": ["--nbatch", "16", "--nstep", "5"],
}


def test_every_example_is_tried() -> None:
    assert sorted(path.name for path in (ROOT / "python" / "examples").glob("*.py")) == sorted(EXAMPLES)


@pytest.mark.parametrize("name", EXAMPLES)
def test_examples_run(name, tmp_path) -> None:
    command = [sys.executable, str(ROOT / "python" / "examples" / name), *EXAMPLES[name]]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=300)
    no_plot = name == "swing_up.py" and "no plot: pip install matplotlib" in done.stderr
    assert done.returncode == 0 or no_plot, done.stderr
    assert done.stdout


def test_the_swing_up_plot_says_what_it_shows(tmp_path, monkeypatch) -> None:
    pyplot = pytest.importorskip("matplotlib.pyplot")
    runpy = pytest.importorskip("runpy")
    pyplot.close("all")
    monkeypatch.setattr(sys, "argv", ["swing_up.py", str(tmp_path / "plot.png"), "--quick"])
    runpy.run_path(str(ROOT / "python" / "examples" / "swing_up.py"), run_name="__main__")
    figure = pyplot.gcf()
    assert (tmp_path / "plot.png").stat().st_size > 10_000
    assert "Cart-pole" in figure.get_suptitle()
    labels = [axis.get_ylabel() for axis in figure.axes]
    assert labels == ["cart position, m", "pole angle, rad", "force on the cart, N"]
    legends = [[text.get_text() for text in axis.get_legend().get_texts()] for axis in figure.axes]
    assert legends == [["target", "end of the rail"], ["target: upright"], ["actuator limit"]]
    pyplot.close("all")
