"""The same iLQG with MuJoCo's steps and mjd_transitionFD: one job as JSON on standard input, its iterations as JSON on standard output."""

import json
import sys
import time

import mujoco
import numpy as np

LENGTHS = 0.63 ** np.arange(16)
EPS = 1e-6
LEAST, MOST, FACTOR, ENOUGH = 1e-6, 1e10, 1.6, 1e-4


class Cost:
    """Sums of weighted residuals, and their Gauss-Newton models."""

    def __init__(self, model, terms):
        self.model, self.parts = model, []
        for term in terms:
            kind, _, name = term["quantity"].partition(":")
            if kind in ("qpos", "qvel"):
                joints = [model.joint(name).id] if name else range(model.njnt)
                address = model.jnt_qposadr if kind == "qpos" else model.jnt_dofadr
                rows = [address[j] for j in joints] if kind == "qpos" or name else list(range(model.nv))
            elif kind == "ctrl":
                rows = [model.actuator(name).id] if name else list(range(model.nu))
            else:
                sensor = model.sensor(name)
                rows = list(range(sensor.adr[0], sensor.adr[0] + sensor.dim[0]))
            goal = np.broadcast_to(np.asarray(term["goal"] or [0.0]), len(rows))
            self.parts.append((kind, np.array(rows), goal, term))

    def pieces(self, point, end):
        values = dict(zip(("qpos", "qvel", "ctrl", "sensor"), point))
        h = self.model.opt.timestep
        for kind, rows, goal, term in self.parts:
            weight = term["terminal"] if end else h * term["running"]
            if weight > 0:
                yield kind, rows, values[kind][rows] - goal, weight, term["smooth"]

    def value(self, point, end):
        total = 0.0
        for _, _, r, weight, p in self.pieces(point, end):
            total += weight * (0.5 * r @ r if p is None else (np.sqrt(r * r + p * p) - p).sum())
        return total

    def quadratic(self, point, C, D, end):
        nv, nu = self.model.nv, self.model.nu
        n = 2 * nv + self.model.na
        gradient, hessian = np.zeros(n + nu), np.zeros((n + nu, n + nu))
        unit = np.eye(n + nu)
        first = {"qpos": 0, "qvel": nv, "ctrl": n}
        for kind, rows, r, weight, p in self.pieces(point, end):
            J = np.hstack([C[rows], D[rows]]) if kind == "sensor" else unit[first[kind] + rows]
            s = np.ones_like(r) if p is None else np.sqrt(r * r + p * p)
            curvature = np.ones_like(r) if p is None else p * p / s**3
            gradient += weight * J.T @ (r / s)
            hessian += weight * J.T @ (curvature[:, None] * J)
        return gradient, hessian


def box(H, g, lo, hi, x):
    """The least of x H x / 2 + g x within bounds; the place, and which numbers are free. None if there is none."""
    x = np.clip(x, lo, hi)
    for _ in range(100):
        grad = g + H @ x
        free = ~(((x <= lo) & (grad > 0)) | ((x >= hi) & (grad < 0)))
        if not free.any():
            return x, free
        try:
            np.linalg.cholesky(H[np.ix_(free, free)])
        except np.linalg.LinAlgError:
            return None
        if np.abs(grad[free]).max() < 1e-10 * max(1.0, np.abs(g).max()):
            return x, free
        step = np.zeros_like(x)
        step[free] = -np.linalg.solve(H[np.ix_(free, free)], grad[free])
        value, length = x @ (0.5 * H @ x + g), 1.0
        while True:
            new = np.clip(x + length * step, lo, hi)
            if new @ (0.5 * H @ new + g) - value <= 0.1 * grad @ (new - x) or length < 1e-12:
                break
            length *= 0.6
        if new @ (0.5 * H @ new + g) >= value:
            return x, free
        x = new
    return x, free


class Search:
    def __init__(self, job):
        self.model = model = mujoco.MjModel.from_xml_string(job["xml"])
        for name, value in job["options"].items():
            setattr(model.opt, name, value)
        self.data, self.cost, self.steps = mujoco.MjData(model), Cost(model, job["terms"]), job["steps"]
        self.start = np.array(job["qpos"]), np.array(job["qvel"])
        limited = model.actuator_ctrllimited.astype(bool)
        self.lo = np.where(limited, model.actuator_ctrlrange[:, 0], -np.inf)
        self.hi = np.where(limited, model.actuator_ctrlrange[:, 1], np.inf)

    def state(self, qpos, qvel):
        self.data.qpos, self.data.qvel = qpos, qvel

    def fly(self, u, nominal=None, k=None, K=None, length=0.0):
        model, data = self.model, self.data
        mujoco.mj_resetData(model, data)
        self.state(*self.start)
        points, cost, dq = [], 0.0, np.zeros(model.nv)
        for t in range(self.steps + 1):
            ctrl = np.zeros(model.nu)
            if t < self.steps:
                ctrl = u[t]
                if nominal is not None:
                    mujoco.mj_differentiatePos(model, dq, 1.0, nominal[t][0], data.qpos)
                    dx = np.concatenate([dq, data.qvel - nominal[t][1]])
                    ctrl = np.clip(u[t] + length * k[t] + K[t] @ dx, self.lo, self.hi)
            data.ctrl = ctrl
            qpos, qvel = data.qpos.copy(), data.qvel.copy()
            if t < self.steps:
                mujoco.mj_step(model, data)
            else:
                mujoco.mj_forward(model, data)
            points.append((qpos, qvel, ctrl.copy(), data.sensordata.copy()))
            cost += self.cost.value(points[-1], t == self.steps)
        return points, cost if np.isfinite(cost) else np.inf

    def linearise(self, points):
        model, data = self.model, self.data
        nx, nu, ns, out = 2 * model.nv + model.na, model.nu, model.nsensordata, []
        for t, point in enumerate(points):
            mujoco.mj_resetData(model, data)
            self.state(*point[:2])
            data.ctrl = point[2]
            mujoco.mj_forward(model, data)
            A, B, C, D = np.zeros((nx, nx)), np.zeros((nx, nu)), np.zeros((ns, nx)), np.zeros((ns, nu))
            mujoco.mjd_transitionFD(model, data, EPS, True, A, B, C if ns else None, D if ns else None)
            out.append((A, B, *self.cost.quadratic(point, C, D, t == self.steps)))
        return out

    def backward(self, linear, points, mu):
        n, nu = 2 * self.model.nv + self.model.na, self.model.nu
        Vx, Vxx = linear[-1][2][:n], linear[-1][3][:n, :n]
        k, K, promise, start = [None] * self.steps, [None] * self.steps, np.zeros(2), np.zeros(nu)
        for t in reversed(range(self.steps)):
            A, B, l, L = linear[t]
            AB = np.hstack([A, B])
            q, Q = l + AB.T @ Vx, L + AB.T @ Vxx @ AB
            Quu, Qux = Q[n:, n:], Q[n:, :n]
            regular, u = Quu + mu * np.eye(nu), points[t][2]
            found = box(regular, q[n:], self.lo - u, self.hi - u, start)
            if found is None:
                return None
            k[t], free = found
            K[t] = np.zeros((nu, n))
            if free.any():
                K[t][free] = -np.linalg.solve(regular[np.ix_(free, free)], Qux[free])
            promise += k[t] @ q[n:], 0.5 * k[t] @ Quu @ k[t]
            Vx = q[:n] + K[t].T @ (Quu @ k[t] + q[n:]) + Qux.T @ k[t]
            Vxx = Q[:n, :n] + K[t].T @ Quu @ K[t] + K[t].T @ Qux + Qux.T @ K[t]
            Vxx, start = 0.5 * (Vxx + Vxx.T), k[t]
        return k, K, promise


def run(job):
    search, begin, mu, factor = Search(job), time.perf_counter(), job["regularisation"], 1.0
    points, cost = search.fly(np.array(job["ctrl"]).reshape(search.steps, -1))
    rows, spent = [[0, cost, time.perf_counter() - begin, mu, 0.0]], [0.0, 0.0, 0.0]

    def timed(i, work):
        start = time.perf_counter()
        out = work()
        spent[i] += time.perf_counter() - start
        return out

    linear = timed(0, lambda: search.linearise(points))
    for iteration in range(1, job["iterations"] + 1):
        passed = timed(1, lambda: search.backward(linear, points, mu))
        used, step, gain = mu, 0.0, 0.0
        if passed:
            k, K, promise = passed
            u = [point[2] for point in points]
            tried = timed(2, lambda: [search.fly(u, points, k, K, length) for length in LENGTHS])
            best = min(range(len(tried)), key=lambda i: tried[i][1])
            length = LENGTHS[best]
            gain = cost - tried[best][1]
            if gain > 0 and gain >= -ENOUGH * (length * promise[0] + length**2 * promise[1]):
                step = length
        if step:
            points, cost = tried[best]
            linear = timed(0, lambda: search.linearise(points))
        if step == 0 or step < 0.1:
            factor = max(factor * FACTOR, FACTOR)
            mu = max(mu * factor, LEAST)
        elif step >= 0.3:
            factor = min(factor / FACTOR, 1 / FACTOR)
            mu = mu * factor if mu * factor >= LEAST else 0.0
        rows.append([iteration, cost, time.perf_counter() - begin, used, step])
        small = passed and (-passed[2].sum() <= job["tolerance"] * abs(cost) or (step and gain <= job["tolerance"] * abs(cost)))
        if (small and used <= 1.0) or mu > MOST:
            break
    return {"rows": rows, "seconds": spent, "version": mujoco.__version__}


print(json.dumps(run(json.load(sys.stdin))), flush=True)
