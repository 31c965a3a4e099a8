"""Records motions of bodies, forces between them, and Jacobians of points, at the states of the goldens.

    pip install mujoco==4.0.0 numpy
    python tests/goldens/make_bodies.py            every model that has a golden
    python tests/goldens/make_bodies.py ant hinge  only these

One file per model, bodies/<model>.npz, with one row for each state of <model>.npz:

    cvel cacc cfrc_int cfrc_ext   what mj_rnePostConstraint leaves after mj_forward
    jac_body/<i> jac_geom/<i> jac_site/<i>   mj_jacBody and so on, linear rows, then angular ones, of up to two elements of each kind

Solver settings are those of `make.py`.
"""

import sys

import mujoco
import numpy as np

import make

OUT = make.HERE / "bodies"
FIELDS = "cvel cacc cfrc_int cfrc_ext".split()
POINTS = {"body": mujoco.mj_jacBody, "geom": mujoco.mj_jacGeom, "site": mujoco.mj_jacSite}


def chosen(count):
    """The last element, and one before the middle."""
    return sorted({count // 2, count - 1}) if count else []


def record(path):
    model = mujoco.MjModel.from_xml_path(str(path))
    make.converge(model)
    with np.load(make.HERE / (path.stem + ".npz")) as golden:
        given = {k: golden["in/" + k] for k in make.inputs(model) if "in/" + k in golden}
        count = len(golden["out/ncon"])
    arrays = {}
    for i in range(count):
        data = make.forward(model, {k: v[i] for k, v in given.items()})
        mujoco.mj_rnePostConstraint(model, data)
        rows = {name: np.array(getattr(data, name)) for name in FIELDS}
        for kind, jacobian in POINTS.items():
            for element in chosen(getattr(model, "n" + kind)):
                jac = np.zeros((6, model.nv))
                jacobian(model, data, jac[:3], jac[3:], element)
                rows[f"jac_{kind}/{element}"] = jac
        for name, row in rows.items():
            arrays.setdefault(name, []).append(row)
    size = make.save(OUT / (path.stem + ".npz"), {k: np.array(v) for k, v in arrays.items()})
    print(f"{path.stem:22s} {count} states, {size / 1e3:.1f} kB", flush=True)


def main():
    if mujoco.__version__ != make.VERSION:
        raise SystemExit(f"MuJoCo {make.VERSION} is needed, this is {mujoco.__version__}")
    OUT.mkdir(exist_ok=True)
    wanted = set(sys.argv[1:])
    paths = [p for folder in ("zoo", "unit") for p in sorted((make.MODELS / folder).glob("*.xml"))]
    for path in paths:
        if (not wanted or path.stem in wanted) and (make.HERE / (path.stem + ".npz")).exists():
            record(path)


if __name__ == "__main__":
    main()
