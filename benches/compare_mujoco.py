"""Speed beside MuJoCo's C engine, in one run on one machine, with the error of our steps.

    pip install mujoco==4.0.0 numpy
    cargo build --release
    python benches/compare_mujoco.py models/zoo/humanoid18.xml models/zoo/ant.xml
    python benches/compare_mujoco.py MODEL... --precision f32 f64 --threads 1 --core 1 --option integrator=Euler --lenient

For every model and precision, `lanesim bench --json` and MuJoCo's batch rollout run in turn, --repeats times; the ratio is
the median of the ratios of neighbours, so that a machine that slows down for a while slows down both. Both sides start their
worlds from 32 states that were warmed up under uniform control noise for 2 s (500 to 2000 steps, or --warm-up), copied with noise
of 0.01 on the velocity, and redraw the controls at every step, in all of their ranges or in a share of them (--noise). MuJoCo's controls are drawn before its clock starts. With one thread, both
are kept on one core where the system allows it.

--option is passed on to both sides. --lenient lets us leave out what we do not support; MuJoCo's sensors are then switched off,
because they are among what is left out.

Writes benches/records/<date>-<name>/compare.md, the table, and compare.jsonl beside it, everything as measured; --dry-run
prints only. The table names the commit and says if there were changes on top of it.
"""

import argparse
import datetime
import json
import math
import os
import pathlib
import platform
import re
import statistics
import subprocess
import sys
import time

import mujoco
import numpy as np
from mujoco.batch import Batch

ROOT = pathlib.Path(__file__).resolve().parent.parent
BASES = 32
WARM_UP_SECONDS, WARM_UP_STEPS = 2.0, (500, 2000)
START_VELOCITY, COPY_VELOCITY = 0.05, 0.01
STATE = mujoco.mjtState.mjSTATE_FULLPHYSICS
ENUMS = {"integrator": (mujoco.mjtIntegrator, "mjINT_"), "cone": (mujoco.mjtCone, "mjCONE_"),
         "solver": (mujoco.mjtSolver, "mjSOL_")}
COLUMNS = ("model", "precision", "threads", "steps/s", "MuJoCo", "ratio", "lost", "error, median", "worst", "contacts",
           "occupancy", "iterations", "slowest of block")


# ---- MuJoCo ---------------------------------------------------------------------------------------------------------------

class Reference:
    """MuJoCo's batch of one model, ready to be run again and again from the same states."""

    def __init__(self, path, args):
        self.model = mujoco.MjModel.from_xml_path(str(path))
        for name, value in args.option:
            set_option(self.model, name, value)
        if args.lenient:
            self.model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_SENSOR)
        rng = np.random.default_rng(args.seed)
        self.states = self.starts(args, rng)
        low, high = self.control_range(args.noise)
        self.controls = rng.uniform(low, high, (args.worlds, args.steps, self.model.nu))
        self.batch = Batch(self.model, args.worlds, nthread=args.threads)

    def control_range(self, share):
        limited = self.model.actuator_ctrllimited.astype(bool)
        ends = self.model.actuator_ctrlrange
        low, high = np.where(limited, ends[:, 0], -1.0), np.where(limited, ends[:, 1], 1.0)
        cut = (1 - share) * (high - low) / 2
        return low + cut, high - cut

    def starts(self, args, rng):
        worlds, data, (low, high) = args.worlds, mujoco.MjData(self.model), self.control_range(args.noise)
        least, most = WARM_UP_STEPS
        steps = min(most, max(least, math.ceil(WARM_UP_SECONDS / self.model.opt.timestep)))
        steps = steps if args.warm_up is None else args.warm_up
        rows = np.empty((min(BASES, worlds), mujoco.mj_stateSize(self.model, int(STATE))))
        for row in rows:
            mujoco.mj_resetData(self.model, data)
            data.qvel[:] = START_VELOCITY * rng.uniform(-1, 1, self.model.nv)
            for _ in range(steps):
                data.ctrl[:] = rng.uniform(low, high)
                mujoco.mj_step(self.model, data)
            mujoco.mj_getState(self.model, data, row, int(STATE))
        states = rows[np.arange(worlds) % len(rows)]
        velocity = slice(1 + self.model.nq, 1 + self.model.nq + self.model.nv)
        states[:, velocity] += COPY_VELOCITY * rng.standard_normal((worlds, self.model.nv))
        return states

    def measure(self):
        """Steps per second."""
        worlds, steps, _ = self.controls.shape
        self.batch.state[:, :self.states.shape[1]] = self.states
        start = time.perf_counter()
        self.batch.rollout(steps, self.controls)
        return worlds * steps / (time.perf_counter() - start)


def set_option(model, name, value):
    """An attribute of MJCF's `option`, as text."""
    if name in ENUMS:
        kind, prefix = ENUMS[name]
        setattr(model.opt, name, int(getattr(kind, prefix + value.upper())))
        return
    numbers = [float(x) for x in value.split()]
    old = getattr(model.opt, name)
    if np.ndim(old):
        old[:] = numbers
    else:
        setattr(model.opt, name, type(old)(numbers[0]))


# ---- lanesim --------------------------------------------------------------------------------------------------------------

def bench(path, precision, args):
    """One run of `lanesim bench`, as it prints it."""
    command = [args.lanesim, "bench", path, "--worlds", args.worlds, "--steps", args.steps, "--threads", args.threads,
               "--precision", precision, "--noise", args.noise, "--seed", args.seed, "--json"]
    if args.warm_up is not None:
        command += ["--warm-up", args.warm_up]
    for name, value in args.option:
        command += ["--option", f"{name}={value}"]
    if args.lenient:
        command.append("--lenient")
    done = subprocess.run([str(x) for x in command], capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"{path}: lanesim says\n{done.stderr}")
    return json.loads(done.stdout)


# ---- comparison -----------------------------------------------------------------------------------------------------------

def compare(path, args):
    """One record per precision."""
    reference = Reference(path, args)
    reference.measure()  # pages, caches, clock of the processor
    for precision in args.precision:
        pairs = [(bench(path, precision, args), reference.measure()) for _ in range(args.repeats)]
        runs, theirs = zip(*pairs)
        ours = [run["steps_per_second"] for run in runs]
        record = dict(runs[0], model=path.stem)
        record["steps_per_second"] = statistics.median(ours)
        record["mujoco_steps_per_second"] = statistics.median(theirs)
        record["ratio"] = statistics.median(a / b for a, b in zip(ours, theirs))
        record["runs"] = [{"lanesim": a, "mujoco": b} for a, b in zip(ours, theirs)]
        yield record


def row(record):
    number = lambda name, form: "-" if record.get(name) is None else format(record[name], form)
    return (record["model"], record["precision"], str(record["threads"]), number("steps_per_second", ",.0f"),
            number("mujoco_steps_per_second", ",.0f"), number("ratio", ".2f"), str(record["lost"]),
            number("step_error_median", ".1e"), number("step_error_max", ".1e"), number("ncon_mean", ".2f"),
            number("slot_occupancy", ".2f"), number("solver_niter_mean", ".2f"), number("solver_niter_block_max_mean", ".2f"))


def table(records):
    rows = [COLUMNS, ("---",) * len(COLUMNS), *map(row, records)]
    for precision in dict.fromkeys(r["precision"] for r in records):
        ratios = [r["ratio"] for r in records if r["precision"] == precision]
        mean = f"{math.exp(statistics.fmean(map(math.log, ratios))):.2f}"
        rows.append(("geometric mean", precision, "", "", "", mean) + ("",) * (len(COLUMNS) - 6))
    return "\n".join("| " + " | ".join(cells) + " |" for cells in rows)


def output(command):
    try:
        return subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return ""


def cpu():
    try:
        found = re.search(r"model name\s*:\s*(.*)", pathlib.Path("/proc/cpuinfo").read_text())
    except OSError:
        found = None
    return found[1] if found else platform.processor() or platform.machine()


def heading(records, args):
    commit = output(["git", "rev-parse", "--short=12", "HEAD"]) or "unknown"
    changes = ", with uncommitted changes" if output(["git", "status", "--porcelain", "--untracked-files=no"]) else ""
    options = "".join(f" {name}={value}" for name, value in args.option) or " the models' own"
    rules = " Lenient: what we do not support is left out, MuJoCo's sensors are off." if args.lenient else ""
    pinned = f"core {args.core}" if args.core is not None else "no core in particular"
    return "\n".join([
        f"# Beside MuJoCo {mujoco.__version__}, {datetime.date.today()}", "",
        f"- {cpu()}, {records[0]['isa']}; {platform.system()} {platform.release()}",
        f"- commit {commit}{changes}; {output(['rustc', '--version']) or 'rustc unknown'}; Python {platform.python_version()}, "
        f"NumPy {np.__version__}",
        f"- {args.worlds} worlds, {args.steps} steps, {args.threads} thread(s) on {pinned}, {args.repeats} pairs of runs, "
        f"seed {args.seed}, noise over {args.noise:g} of the control ranges; options:{options}.{rules}", "",
        "Speeds are medians; the ratio is the median of the ratios of neighbouring runs. The error is the relative difference "
        "of the next velocity\nfrom a converged scalar f64 step. Occupancy is the part of a block's contact slots in use; "
        "iterations are a world's mean, and those\nof the slowest world of each block.", ""])


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    name_value = lambda text: tuple(part.strip() for part in text.split("=", 1)) if "=" in text else parser.error(
        f"{text}: expected NAME=VALUE")
    parser.add_argument("models", nargs="+", type=pathlib.Path, metavar="MODEL")
    parser.add_argument("--lanesim", default=ROOT / "target/release/lanesim", help="the program [target/release/lanesim]")
    parser.add_argument("--precision", nargs="+", choices=("f32", "f64"), default=["f32", "f64"])
    parser.add_argument("--worlds", type=int, default=4096)
    parser.add_argument("--steps", type=int, default=100)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--core", type=int, help="the core to stay on [with one thread: the last that may be used]")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--noise", type=float, default=1, metavar="SHARE", help="of the control ranges, around the middle [1]")
    parser.add_argument("--warm-up", type=int, metavar="STEPS", help="[2 s, 500 to 2000 steps]")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--option", action="append", default=[], type=name_value, metavar="NAME=VALUE")
    parser.add_argument("--lenient", action="store_true")
    parser.add_argument("--name", default="compare", help="of the record's folder, after the date: the machine, the occasion")
    parser.add_argument("--dry-run", action="store_true", help="write no record")
    args = parser.parse_args()
    if hasattr(os, "sched_setaffinity"):
        if args.core is None and args.threads == 1:
            args.core = max(os.sched_getaffinity(0))
        if args.core is not None:
            os.sched_setaffinity(0, {args.core})  # children inherit it
    return args


def main():
    args = arguments()
    records = []
    for path in args.models:
        for record in compare(path, args):
            records.append(record)
            print(" | ".join(row(record)), file=sys.stderr, flush=True)
    text = heading(records, args) + "\n" + table(records) + "\n"
    print(text)
    if not args.dry_run:
        folder = ROOT / "benches/records" / f"{datetime.date.today()}-{args.name}"
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "compare.md").write_text(text)
        (folder / "compare.jsonl").write_text("".join(json.dumps(record) + "\n" for record in records))


if __name__ == "__main__":
    main()
