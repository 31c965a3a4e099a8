"""MJCF from MuJoCo's compiled models, number by number.

``MjSpec.to_xml`` and ``mj_saveLastXML`` round to six digits, and the latter knows nothing of models that were changed after
loading. So the text is written here, from the arrays. What MJCF cannot say, or lanesim has not got, is refused by the loader
or by the comparison of the arrays at the end.
"""

from __future__ import annotations

import copy
from typing import Any, Iterator

import numpy as np
from numpy.typing import NDArray

from .errors import ModelError
from .spec import Element, Spec

__all__ = ["differences", "spec_of", "stale"]

JOINTS = ("free", "ball", "slide", "hinge")
GEOMS = ("plane", "hfield", "sphere", "capsule", "ellipsoid", "cylinder", "box", "mesh", "sdf")
SIZES = (3, 0, 1, 2, 3, 2, 3, 0, 0)
"""How many sizes a geom of each type has."""
GEOM = "pos quat contype conaffinity condim priority friction solmix solref solimp margin gap group"
"""What a geom's attributes and arrays have in common."""
EQUALITIES = ("connect", "weld", "joint", "tendon", "flex")
HELD = {"connect": "", "weld": "", "joint": "joint", "tendon": "tendon"}
"""Those that are built, and what they hold: bodies or sites where it is not said."""
SENSORS = {
    "jointactfrc": "jointactuatorfrc", "tendonactfrc": "tendonactuatorfrc", "geomdist": "distance", "geomnormal": "normal",
    "geomfromto": "fromto",
}  # fmt: skip
"""Tags of sensors that are not called like their type."""
INPUTS = ("pos", "vel", "ff", "voltage")
INTERPOLATIONS = ("zoh", "linear", "cubic")
OBJECTS = {1: "body", 2: "xbody", 3: "joint", 5: "geom", 6: "site", 7: "camera", 18: "tendon", 19: "actuator"}
STAGES = ("pos", "pos", "vel", "acc")
CONTACT_FIELDS = ("found", "force", "torque", "dist", "pos", "normal", "tangent", "linvel", "angvel")
REDUCE = ("none", "mindist", "maxforce", "netforce")
RAY_FIELDS = ("dist", "dir", "origin", "point", "normal", "depth")
DATA_TYPES = ("real", "positive", "axis", "quaternion")
WRAPS = ("", "joint", "pulley", "site", "sphere", "cylinder")
GAINS = ("fixed", "affine", "muscle", "dcmotor", "so3", "pid", "user")
BIASES = ("none", "affine", "muscle", "dcmotor", "so3", "user")
DYNAMICS = ("none", "integrator", "filter", "filterexact", "muscle", "dcmotor", "pid", "user")
TRANSMISSIONS = ("joint", "jointinparent", "slidercrank", "tendon", "site", "body")
TOLERANCE = 1e-9
"""Largest difference between arrays that rounding may make, relative to the largest entry."""
SINGLE = 1e-6
"""The same for arrays that follow from vertices of meshes, which are in single precision."""
PLACES = ("geom_size", "geom_rbound")
STALE = 1e-6
"""The same for constants that MuJoCo derives a second time."""


def spec_of(m: Any) -> Spec:
    """The MJCF of an ``mujoco.MjModel``."""
    return _Writer(m).spec


class _Writer:
    """Writes a model section by section."""

    def __init__(self, m: Any) -> None:
        self.m = m
        self.spec = Spec(m.names[: m.names.index(b"\0")].decode())
        refused = [name for name in ("nplugin", "nflex", "nhfield") if getattr(m, name, 0)]
        if refused:
            kinds = {"nplugin": "plugins", "nflex": "flexible bodies", "nhfield": "height fields"}
            what = " and ".join(kinds[name] for name in refused)
            raise ModelError(f"the MjModel has {what}, which are not supported")
        # Joints, bodies and geoms that others refer to need a name.
        self.named: dict[tuple[str, int], str] = {}
        self._name_referred()
        self.spec.compiler.set(angle="radian", autolimits=False, inertiafromgeom=False, balanceinertia=False)
        self._options()
        self._bodies()
        self._contacts()
        self._actuators()
        self._others()
        self._keys()

    def name(self, kind: str, i: int) -> str | None:
        """Name of an element; None if it has none and nobody refers to it."""
        return getattr(self.m, kind)(i).name or self.named.get((kind, i))

    def _name_referred(self) -> None:
        m = self.m
        referred = [("geom", int(g)) for g in (*m.pair_geom1, *m.pair_geom2)]
        referred += [("body", int(s) >> shift & 0xFFFF) for s in m.exclude_signature for shift in (0, 16)]
        for types, ids in ((m.sensor_objtype, m.sensor_objid), (m.sensor_reftype, m.sensor_refid)):
            seen = [(OBJECTS.get(int(kind)), int(i)) for kind, i in zip(types, ids) if i >= 0]
            referred += [("body" if kind == "xbody" else kind, i) for kind, i in seen if kind]
        kinds = {"joint": "joint", "jointinparent": "joint", "tendon": "tendon", "site": "site", "slidercrank": "site"}
        kinds["body"] = "body"
        for a in range(m.nactuator):
            kind = kinds.get(self._transmission(a))
            referred += [(kind, int(i)) for i in m.actuator_trnid[a] if kind and i >= 0]
        for e in range(m.neq):
            what = {0: "tendon" if m.eq_type[e] == 3 else "joint", 1: "body", 6: "site"}.get(int(m.eq_objtype[e]))
            if what and int(m.eq_type[e]) < len(HELD):
                referred += [(what, int(i)) for i in (m.eq_obj1id[e], m.eq_obj2id[e]) if i >= 0]
        for w in range(m.nwrap):
            kind = {1: "joint", 3: "site", 4: "geom", 5: "geom"}.get(int(m.wrap_type[w]))
            referred += [(kind, int(m.wrap_objid[w]))] if kind else []
            referred += [("site", int(m.wrap_prm[w]))] if kind == "geom" and m.wrap_prm[w] >= 0 else []
        for kind, i in referred:
            if not getattr(m, kind)(i).name:
                self.named[kind, i] = f"{kind} {i}"

    def _transmission(self, a: int) -> str:
        kind = int(self.m.actuator_trntype[a])
        if kind == len(TRANSMISSIONS):  # An orientation servo's.
            return "joint" if self.m.actuator_trnid[a][1] < 0 else "site"
        return TRANSMISSIONS[kind] if kind < len(TRANSMISSIONS) else f"transmission {kind}"

    def _options(self) -> None:
        import mujoco

        opt, option = self.m.opt, self.spec.option
        plain = (
            "timestep gravity wind magnetic density viscosity impratio tolerance ls_tolerance noslip_tolerance "
            "ccd_tolerance sleep_tolerance iterations ls_iterations noslip_iterations ccd_iterations"
        )
        option.set(**{name: getattr(opt, name) for name in plain.split()})
        option.set(
            cone=mujoco.mjtCone(opt.cone).name[7:].lower(),
            solver={0: "PGS", 1: "CG", 2: "Newton"}[int(opt.solver)],
        )
        integrators = {"IMPLICIT": "implicit", "IMPLICITFAST": "implicitfast", "DISCRETE": "discrete"}
        name = mujoco.mjtIntegrator(opt.integrator).name[6:]
        option.set(integrator=integrators.get(name, "Euler" if name == "EULER" else name))
        if opt.enableflags & int(mujoco.mjtEnableBit.mjENBL_OVERRIDE):
            option.set(o_margin=opt.o_margin, o_solref=opt.o_solref, o_solimp=opt.o_solimp, o_friction=opt.o_friction)
        groups = [g for g in range(31) if opt.disableactuator >> g & 1]
        if groups:
            option.set(actuatorgroupdisable=groups)
        flags = {}
        for bit in mujoco.mjtDisableBit.__members__.items():
            if bit[0].startswith("mjDSBL") and opt.disableflags & int(bit[1]):
                flags[bit[0][7:].lower()] = "disable"
        for bit in mujoco.mjtEnableBit.__members__.items():
            if bit[0].startswith("mjENBL") and opt.enableflags & int(bit[1]):
                flags[bit[0][7:].lower()] = "enable"
        if flags:
            option.add("flag", **flags)

    def _sleep(self, b: int) -> str | None:
        """Whether the tree that a body begins may sleep, if that was said."""
        m = self.m
        if m.body_dofnum[b] == 0 or m.body_treeid[m.body_parentid[b]] >= 0:
            return None
        return {3: "never", 4: "allowed", 5: "init"}.get(int(m.tree_sleep_policy[m.body_treeid[b]]))

    def _bodies(self) -> None:
        m = self.m
        elements = [self.spec.worldbody]
        for b in range(1, m.nbody):
            body = elements[m.body_parentid[b]].add(
                "body",
                name=self.name("body", b),
                pos=m.body_pos[b],
                quat=m.body_quat[b],
                mocap=True if m.body_mocapid[b] >= 0 else None,
                gravcomp=m.body_gravcomp[b] or None,
                sleep=self._sleep(b),
            )
            elements.append(body)
            body.add(
                "inertial",
                pos=m.body_ipos[b],
                quat=m.body_iquat[b],
                mass=m.body_mass[b],
                diaginertia=m.body_inertia[b],
            )
            for j in range(m.body_jntadr[b], m.body_jntadr[b] + m.body_jntnum[b]):
                self._joint(body, j)
        for g in range(m.ngeom):
            self._geom(elements[m.geom_bodyid[g]], g)
        for s in range(m.nsite):
            self._site(elements[m.site_bodyid[s]], s)
        for c in range(m.ncam):
            self._camera(elements[m.cam_bodyid[c]], c)

    def _joint(self, body: Element, j: int) -> None:
        m, kind = self.m, int(self.m.jnt_type[j])
        dof, q, scalar = m.jnt_dofadr[j], m.jnt_qposadr[j], kind > 1
        body.add(
            "joint",
            name=self.name("joint", j),
            type=JOINTS[kind],
            pos=None if kind == 0 else m.jnt_pos[j],
            axis=m.jnt_axis[j] if scalar else None,
            ref=m.qpos0[q] if scalar else None,
            springref=m.qpos_spring[q] if scalar else None,
            stiffness=_series(m.jnt_stiffness[j], m.jnt_stiffnesspoly[j]),
            springyield=m.jnt_springyield[j] or None,
            damping=_series(m.dof_damping[dof], m.dof_dampingpoly[dof]),
            armature=m.dof_armature[dof],
            frictionloss=m.dof_frictionloss[dof],
            solreffriction=m.dof_solref[dof],
            solimpfriction=m.dof_solimp[dof],
            limited=bool(m.jnt_limited[j]),
            margin=m.jnt_margin[j],
            solreflimit=m.jnt_solref[j],
            solimplimit=m.jnt_solimp[j],
            actuatorfrclimited=bool(m.jnt_actfrclimited[j]),
            actuatorfrcrange=m.jnt_actfrcrange[j] if m.jnt_actfrcrange[j].any() else None,
            actuatorgravcomp=True if m.jnt_actgravcomp[j] else None,
            group=m.jnt_group[j],
            range=m.jnt_range[j] if m.jnt_range[j].any() else None,
        )

    def _geom(self, body: Element, g: int) -> None:
        m, kind = self.m, int(self.m.geom_type[g])
        if kind >= len(GEOMS):
            raise ModelError(f'geom {g} "{m.geom(g).name}" of the MjModel has type {kind}, which is not supported')
        fluid = m.geom_fluid[g].any()
        moving = getattr(m, "geom_surfacevel", np.zeros((m.ngeom, 1)))[g]
        sticky = np.atleast_1d(getattr(m, "geom_adhesion", np.zeros(m.ngeom))[g])
        body.add(
            "geom",
            name=self.name("geom", g),
            type=GEOMS[kind],
            size=_sizes(m.geom_size[g], SIZES[kind]),
            mesh=self._mesh_name(m.geom_dataid[g]) if kind == 7 else None,
            **_copied(m, "geom", g, GEOM),
            fluidshape="ellipsoid" if fluid else None,
            rgba=m.geom_rgba[g] if m.geom_rgba[g][3] == 0 else None,
            surfacevel=moving if moving.any() else None,
            adhesion=sticky if sticky.any() else None,
        )

    def _site(self, body: Element, s: int) -> None:
        m, kind = self.m, int(self.m.site_type[s])
        body.add(
            "site",
            name=self.name("site", s),
            type=GEOMS[kind],
            **_copied(m, "site", s, "size pos quat group"),
        )

    def _camera(self, body: Element, c: int) -> None:
        m = self.m
        lens: dict[str, Any] = {"fovy": m.cam_fovy[c]}
        if m.cam_sensorsize[c].all():
            focal, principal = m.cam_intrinsic[c][:2], m.cam_intrinsic[c][2:]
            lens = {"sensorsize": m.cam_sensorsize[c], "focal": focal, "principal": principal}
        body.add(
            "camera",
            name=self.name("camera", c),
            mode=("fixed", "track", "trackcom", "targetbody", "targetbodycom")[m.cam_mode[c]],
            projection=("perspective", "orthographic")[m.cam_projection[c]],
            resolution=m.cam_resolution[c],
            **_copied(m, "cam", c, "pos quat"),
            **lens,
        )

    def _contacts(self) -> None:
        m = self.m
        for p in range(m.npair):
            self.spec.contact.add(
                "pair",
                name=m.pair(p).name or None,
                geom1=self.name("geom", m.pair_geom1[p]),
                geom2=self.name("geom", m.pair_geom2[p]),
                condim=m.pair_dim[p],
                friction=m.pair_friction[p],
                solref=m.pair_solref[p],
                solreffriction=m.pair_solreffriction[p] if m.pair_solreffriction[p].any() else None,
                solimp=m.pair_solimp[p],
                margin=m.pair_margin[p],
                gap=m.pair_gap[p],
            )
        for e in range(m.nexclude):
            bodies = [int(m.exclude_signature[e]) >> shift & 0xFFFF for shift in (16, 0)]
            body1, body2 = (self.name("body", b) for b in bodies)
            self.spec.contact.add("exclude", name=m.exclude(e).name or None, body1=body1, body2=body2)

    def _actuators(self) -> None:
        m = self.m
        for a in range(m.nactuator):
            kind, target = self._transmission(a), m.actuator_trnid[a]
            where: dict[str, Any] = {}
            if kind == "slidercrank":
                where = {"cranksite": self.name("site", target[0]), "slidersite": self.name("site", target[1])}
                where["cranklength"] = m.actuator_cranklength[a]
            elif kind in TRANSMISSIONS:
                name = "joint" if kind == "jointinparent" else kind
                where = {kind: self.name(name, target[0])}
                if kind == "site" and target[1] >= 0:
                    where["refsite"] = self.name("site", target[1])
            else:
                raise ModelError(f'actuator {a} "{m.actuator(a).name}" of the MjModel has {kind}: not supported')
            self._actuator(a, where)

    def _actuator(self, a: int, where: dict[str, Any]) -> None:
        m = self.m
        dynamic = int(m.actuator_dyntype[a])
        # Forces may be several.
        out, several = int(m.actuator_outadr[a]), int(m.actuator_outnum[a]) > 1
        active: dict[str, Any] = {}
        if dynamic:
            active = dict(
                actlimited=bool(m.actuator_actlimited[a]),
                actrange=m.actuator_actrange[a] if m.actuator_actrange[a].any() else None,
                actdim=m.actuator_actnum[a] if m.actuator_actnum[a] != 1 else None,
            )
        self.spec.actuator.add(
            "general",
            name=m.actuator(a).name or None,
            gaintype=GAINS[int(m.actuator_gaintype[a])],
            biastype=BIASES[int(m.actuator_biastype[a])],
            dyntype=DYNAMICS[dynamic],
            dynprm=m.actuator_dynprm[a],
            actearly=True if m.actuator_actearly[a] else None,
            gainprm=m.actuator_gainprm[a],
            biasprm=m.actuator_biasprm[a],
            **self._controls(a),
            forcelimited=bool(m.actuator_forcelimited[a]),
            forcerange=m.actuator_forcerange[a] if m.actuator_forcerange[a].any() else None,
            gear=None if several else m.actuator_gear[out],
            armature=m.actuator_armature[a] or None,
            damping=(
                _series(m.actuator_damping[a], m.actuator_dampingpoly[a]) if _any(m, "actuator_damping", a) else None
            ),
            lengthrange=m.actuator_lengthrange[out] if m.actuator_lengthrange[out].any() else None,
            group=m.actuator_group[a],
            **_history(m, "actuator", a),
            **where,
            **active,
        )

    def _controls(self, a: int) -> dict[str, Any]:
        """What an actuator is told, and the ranges of that, as attributes."""
        m = self.m
        first, count = int(m.actuator_ctrladr[a]), int(m.actuator_ctrlnum[a])
        gain = GAINS[int(m.actuator_gaintype[a])]
        if gain == "so3":
            limits = m.actuator_ctrlrange[first]
            limited = {"ctrllimited": bool(m.actuator_ctrllimited[first]), "ctrlrange": limits if limits.any() else None}
            return {"input": ("expmap", "quat")[int(m.actuator_ctrlspec[a]) - 1], **limited}
        several = gain in ("pid", "dcmotor")
        bits = int(m.actuator_ctrlspec[a])
        words = [word for i, word in enumerate(INPUTS) if bits >> i & 1]
        out: dict[str, Any] = {"input": " ".join(words) or "none"} if several else {}
        for word, u in zip(words if several else ("pos",), range(first, first + count)):
            # A controller has a range for each; of other actuators all have one.
            name = {"vel": "velrange", "ff": "ffrange"}.get(word) if out.get("input") and not _is_motor(m, a) else None
            limits = m.actuator_ctrlrange[u]
            if name:
                out[name] = limits if m.actuator_ctrllimited[u] else None
            else:
                out["ctrllimited"] = bool(m.actuator_ctrllimited[u])
                out["ctrlrange"] = limits if limits.any() else None
        return out

    def _others(self) -> None:
        """What the loader has a word about: a note, a refusal, or a loss if it is lenient."""
        import mujoco

        m, root = self.m, Element(self.spec._element)
        if m.ntendon:
            tendons = root.add("tendon")
            for t in range(m.ntendon):
                self._tendon(tendons, t)
        if m.neq:
            equalities = root.add("equality")
            for e in range(m.neq):
                kind = EQUALITIES[min(int(m.eq_type[e]), 4)]
                active = None if m.eq_active0[e] else False
                law = {"solref": m.eq_solref[e], "solimp": m.eq_solimp[e]} if kind in HELD else {}
                name = m.equality(e).name or f"equality {e}"
                equalities.add(kind, name=name, active=active, **law, **self._held(kind, e))
        if m.nsensor:
            sensors = root.add("sensor")
            for s in range(m.nsensor):
                kind = mujoco.mjtSensor(m.sensor_type[s]).name.removeprefix("mjSENS_").lower()
                tag = SENSORS.get(kind, kind)
                numbers = {"cutoff": m.sensor_cutoff[s], "noise": m.sensor_noise[s], **_history(m, "sensor", s)}
                sensors.add(tag, name=m.sensor(s).name or f"sensor {s}", **numbers, **self._sensed(tag, s))
        if (m.geom_type == GEOMS.index("mesh")).any():
            assets = root.add("asset")
            for i in range(m.nmesh):
                vertices, faces = self._mesh(i)
                written = {"vertex": vertices.ravel(), "face": faces.ravel()}
                # Bodies have their masses, so any way of finding the mesh's own does. Its frame is as MuJoCo found it: of a
                # symmetric mesh rounding could turn the axes once more. In its file's axes MuJoCo tells flat faces apart.
                written |= {"refpos": m.mesh_pos[i], "refquat": m.mesh_quat[i]}
                assets.add("mesh", name=self._mesh_name(i), inertia="shell", centered=True, **written)

    def _sensed(self, tag: str, s: int) -> dict[str, Any]:
        """What a sensor is about, as attributes; nothing of a kind that is not built."""
        m = self.m
        sides = [(m.sensor_objtype, m.sensor_objid), (m.sensor_reftype, m.sensor_refid)]
        objects = [(OBJECTS.get(int(kind[s])), int(number[s])) for kind, number in sides if number[s] >= 0]
        if any(kind is None for kind, _ in objects):
            return {}
        named = [(kind, self.name("body" if kind == "xbody" else kind, i)) for kind, i in objects if kind]
        if tag.startswith("frame"):
            prefixed = zip(("obj", "ref"), named)
            return {prefix + what: x for prefix, of in prefixed for what, x in zip(("type", "name"), of)}
        if tag in ("distance", "normal", "fromto"):
            return {f"{kind}{side}": name for side, (kind, name) in zip((1, 2), named)}
        if tag == "contact":
            return self._contact_sensor(s)
        if tag == "insidesite":
            (kind, name), (_, site) = named
            return {"site": site, "objtype": kind, "objname": name}
        if tag == "user":
            about = {"objtype": named[0][0], "objname": named[0][1]} if named else {}
            stage, data = STAGES[int(m.sensor_needstage[s])], DATA_TYPES[int(m.sensor_datatype[s])]
            return {**about, "dim": int(m.sensor_dim[s]), "needstage": stage, "datatype": data}
        about = dict(named)
        if tag == "rangefinder":
            bits = int(m.sensor_intprm[s][0])
            about["data"] = " ".join(field for i, field in enumerate(RAY_FIELDS) if bits >> i & 1)
        return about

    def _contact_sensor(self, s: int) -> dict[str, Any]:
        """What a contact sensor matches and returns."""
        m = self.m
        bits, reduce, num = (int(x) for x in m.sensor_intprm[s][:3])
        about: dict[str, Any] = {"reduce": REDUCE[reduce], "num": num}
        about["data"] = " ".join(field for i, field in enumerate(CONTACT_FIELDS) if bits >> i & 1)
        for side, types, ids in ((1, m.sensor_objtype, m.sensor_objid), (2, m.sensor_reftype, m.sensor_refid)):
            kind = OBJECTS.get(int(types[s]))
            if kind and ids[s] >= 0:
                name = self.name("body" if kind == "xbody" else kind, int(ids[s]))
                about["site" if kind == "site" else {"xbody": "subtree"}.get(kind, kind) + str(side)] = name
        return about

    def _tendon(self, tendons: Element, t: int) -> None:
        m = self.m
        points = range(m.tendon_adr[t], m.tendon_adr[t] + m.tendon_num[t])
        tendon = tendons.add(
            "fixed" if WRAPS[m.wrap_type[points[0]]] == "joint" else "spatial",
            name=self.name("tendon", t),
            springlength=m.tendon_lengthspring[t],
            stiffness=_series(m.tendon_stiffness[t], m.tendon_stiffnesspoly[t]),
            springyield=m.tendon_springyield[t] or None,
            damping=_series(m.tendon_damping[t], m.tendon_dampingpoly[t]),
            armature=m.tendon_armature[t],
            frictionloss=m.tendon_frictionloss[t],
            solreffriction=m.tendon_solref_fri[t],
            solimpfriction=m.tendon_solimp_fri[t],
            limited=bool(m.tendon_limited[t]),
            range=m.tendon_range[t] if m.tendon_range[t].any() else None,
            margin=m.tendon_margin[t],
            solreflimit=m.tendon_solref_lim[t],
            solimplimit=m.tendon_solimp_lim[t],
            actuatorfrclimited=bool(m.tendon_actfrclimited[t]),
            actuatorfrcrange=m.tendon_actfrcrange[t] if m.tendon_actfrcrange[t].any() else None,
            group=m.tendon_group[t],
        )
        for w in points:
            kind, i, number = WRAPS[m.wrap_type[w]], int(m.wrap_objid[w]), m.wrap_prm[w]
            if kind == "joint":
                tendon.add("joint", joint=self.name("joint", i), coef=number)
            elif kind == "pulley":
                tendon.add("pulley", divisor=number)
            elif kind == "site":
                tendon.add("site", site=self.name("site", i))
            else:
                side = self.name("site", int(number)) if number >= 0 else None
                tendon.add("geom", geom=self.name("geom", i), sidesite=side)

    def _mesh_name(self, mesh: int) -> str:
        return str(self.m.mesh(mesh).name or f"mesh {mesh}")

    def _mesh(self, mesh: int) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
        """Vertices of a mesh as they were in its file, but for its scale, and its faces."""
        import mujoco

        m = self.m
        turned = np.empty(9)
        mujoco.mju_quat2Mat(turned, m.mesh_quat[mesh])
        start, count = m.mesh_vertadr[mesh], m.mesh_vertnum[mesh]
        first, faces = m.mesh_faceadr[mesh], m.mesh_facenum[mesh]
        vertices = np.array(m.mesh_vert[start : start + count], float) @ turned.reshape(3, 3).T + m.mesh_pos[mesh]
        return vertices, np.array(m.mesh_face[first : first + faces])

    def _held(self, kind: str, e: int) -> dict[str, Any]:
        """What an equality constraint holds, as attributes."""
        import mujoco

        m = self.m
        if kind not in HELD:
            return {}
        what = HELD[kind] or ("site" if int(m.eq_objtype[e]) == int(mujoco.mjtObj.mjOBJ_SITE) else "body")
        ids = (int(m.eq_obj1id[e]), int(m.eq_obj2id[e]))
        held: dict[str, Any] = {f"{what}{n}": self.name(what, i) for n, i in enumerate(ids, 1) if i >= 0}
        data = m.eq_data[e]
        if kind in ("joint", "tendon"):
            held["polycoef"] = data[:5]
        elif what == "body":
            held["anchor"] = data[:3]
        if kind == "weld":
            held["torquescale"] = data[10]
            if what == "body" and not data[11]:  # Otherwise it is that of the reference configuration.
                held["relpose"] = data[3:10]
        return held

    def _keys(self) -> None:
        m = self.m
        for k in range(m.nkey):
            rows = {"qpos": m.key_qpos, "qvel": m.key_qvel, "act": m.key_act, "ctrl": m.key_ctrl}
            rows.update(mpos=m.key_mpos, mquat=m.key_mquat, plastic=m.key_plastic)
            given = {name: array[k] for name, array in rows.items() if array[k].size}
            self.spec.keyframe.add("key", name=m.key(k).name or None, time=m.key_time[k], **given)


def _is_motor(m: Any, a: int) -> bool:
    return GAINS[int(m.actuator_gaintype[a])] == "dcmotor"


def _history(m: Any, what: str, i: int) -> dict[str, Any]:
    """What an actuator or sensor keeps of its past, as attributes."""
    count, interpolation = getattr(m, f"{what}_history")[i]
    if count <= 0:
        return {}
    interval = m.sensor_interval[i] if what == "sensor" else np.zeros(2)
    return {
        "nsample": int(count),
        "interp": INTERPOLATIONS[int(interpolation)],
        "delay": getattr(m, f"{what}_delay")[i],
        "interval": interval if interval.any() else None,
    }


def _sizes(sizes: NDArray[np.float64], count: int) -> NDArray[np.float64] | None:
    """The sizes that a shape has, and those after them that somebody set all the same."""
    last = int(np.flatnonzero(sizes)[-1]) + 1 if sizes.any() else 0
    return sizes[: max(count, last)] if count else None


def _copied(m: Any, kind: str, i: int, names: str) -> dict[str, Any]:
    """Attributes of element i that are arrays of that name."""
    return {name: getattr(m, f"{kind}_{name}")[i] for name in names.split()}


def _any(m: Any, name: str, i: int) -> bool:
    return bool(np.any(getattr(m, name)[i]) or np.any(getattr(m, name + "poly")[i]))


def _series(linear: float, rest: NDArray[np.float64]) -> list[float]:
    """Coefficients of a polynomial as MJCF has them, without zeros at the end."""
    rest = np.atleast_1d(rest)
    last = int(np.flatnonzero(rest)[-1]) + 1 if rest.any() else 0
    return [float(linear), *rest[:last].tolist()]


def differences(m: Any, model: Any) -> Iterator[str]:
    """Arrays of a lanesim model that are not those of the MjModel it was made from."""
    for name, size in model.sizes().items():
        if getattr(m, name, size) != size:
            yield f"{name} would be {size} instead of {getattr(m, name)}"
    for name in model.array_names:
        theirs = getattr(m, name, None)
        if theirs is None:
            theirs = getattr(m.opt, name, None)
        if theirs is None or name.startswith("o_"):
            continue
        ours, theirs = np.asarray(getattr(model, name)), np.asarray(theirs)
        if ours.size != theirs.size:
            yield f"{name} would have shape {list(ours.shape)} instead of {list(theirs.shape)}"
            continue
        theirs = theirs.reshape(ours.shape)
        scale = np.abs(theirs).max(initial=0.0)
        tolerance = SINGLE if name in PLACES and m.nmesh else TOLERANCE
        wrong = np.abs(ours - theirs) > tolerance * max(float(scale), 1e-6)
        if wrong.any():
            place = [int(i) for i in np.argwhere(wrong)[0]] if ours.ndim else []
            here, there = float(ours[tuple(place)]), float(theirs[tuple(place)])
            yield f"{name}{place or ''} would be {here:.9g} instead of {there:.9g}"


def stale(m: Any) -> Iterator[str]:
    """Derived constants of an MjModel that do not follow from what it holds now."""
    import mujoco

    fresh = copy.copy(m)
    mujoco.mj_setConst(fresh, mujoco.MjData(fresh))
    for name in ("body_subtreemass", "dof_M0", "dof_invweight0", "body_invweight0", "tendon_invweight0", "tendon_length0", "actuator_acc0"):
        old, new = getattr(m, name), getattr(fresh, name)
        wrong = np.abs(old - new) > STALE * np.abs(new).max(initial=0.0)
        if wrong.any():
            place = [int(i) for i in np.argwhere(wrong)[0]]
            yield f"{name}{place} is {float(old[tuple(place)]):.9g} and should be {float(new[tuple(place)]):.9g}"
