"""Height fields from files: what rays find of them is what MuJoCo's find."""

from __future__ import annotations

import pathlib
import struct
import zlib

import lanesim
import mujoco
import numpy as np
import pytest

ROWS, COLUMNS = 4, 5


def png(values: np.ndarray, depth: int, color: int) -> bytes:
    """A picture of [rows, columns, channels]."""

    def chunk(tag: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + tag + data + struct.pack(">I", zlib.crc32(tag + data))

    rows = b"".join(b"\0" + row.astype(f">u{depth // 8}").tobytes() for row in values)
    header = struct.pack(">IIBBBBB", values.shape[1], values.shape[0], depth, color, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")


def picture(depth: int, color: int, channels: int) -> bytes:
    values = np.random.default_rng(color).integers(0, 2**depth, (ROWS, COLUMNS, channels))
    return png(values, depth, color)


def binary() -> bytes:
    values = np.random.default_rng(0).random((ROWS, COLUMNS)).astype(np.float32)
    return struct.pack("ii", ROWS, COLUMNS) + values.tobytes()


@pytest.mark.parametrize(
    ("data", "kind"),
    [
        (picture(8, 0, 1), ""),
        (picture(16, 0, 1), ""),
        (picture(8, 2, 3), ""),
        (picture(16, 2, 3), ""),
        (picture(8, 4, 2), ""),
        (picture(8, 6, 4), ""),
        (binary(), "content_type='image/vnd.mujoco.hfield'"),
    ],
    ids=["gray", "gray of 16 bits", "color", "color of 16 bits", "gray and alpha", "color and alpha", "binary"],
)
def test_fields_from_files_are_those_of_mujoco(tmp_path: pathlib.Path, data: bytes, kind: str) -> None:
    (tmp_path / "field.png").write_bytes(data)
    places = [(i, j) for i in range(9) for j in range(9)]
    sites = "".join(f"<site name='{i} {j}' pos='{0.22 * i - 0.9} {0.2 * j - 0.8} 0' euler='180 0 0'/>" for i, j in places)
    rays = "".join(f"<rangefinder site='{i} {j}'/>" for i, j in places)
    path = tmp_path / "model.xml"
    path.write_text(
        f"""<mujoco><asset><hfield name='field' file='field.png' {kind} size='1 .9 .5 .1'/></asset>
        <worldbody><geom type='hfield' hfield='field'/>
        <body pos='0 0 3'><joint/><inertial pos='0 0 0' mass='1' diaginertia='1 1 1'/>{sites}</body></worldbody><sensor>{rays}</sensor></mujoco>"""
    )
    exact = mujoco.MjModel.from_xml_path(str(path))
    theirs = mujoco.MjData(exact)
    mujoco.mj_forward(exact, theirs)
    ours = lanesim.Worlds(lanesim.Model.from_xml_path(path), 1).get("sensordata")[0]
    assert np.ptp(theirs.sensordata) > 0.1
    np.testing.assert_allclose(ours, theirs.sensordata, rtol=0, atol=1e-12)
