"""`export`: what other programs read is where the joints are."""

import csv
import json
import shutil
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from gesturegen import export
from gesturegen.cli import main
from gesturegen.motion import bvh, kinematics, rotation
from gesturegen.motion.skeleton import Motion
from tests import tiny
from tests.builders import chain, data_folder, make_skeleton, random_motion

pygltflib = pytest.importorskip("pygltflib", reason="pygltflib is not installed: pip install 'gesturegen[gltf]'")

BRANCHED = make_skeleton(
    ["hips", "spine", "arm", "hand", "leg"],
    [-1, 0, 1, 2, 0],
    [(1, 90, 2), (0, 30, 0), (20, 5, 0), (25, 0, 3), (9, -40, 1)],
)


def run(*arguments):
    return CliRunner().invoke(main, ["export", *map(str, arguments), "-j", "1"])


# --- a reader of its own, by the specification ----------------------------------------------------------------


def read_glb(data: bytes) -> tuple[dict, bytes]:
    magic, version, length = struct.unpack_from("<4sII", data)
    assert (magic, version, length) == (b"glTF", 2, len(data))
    size, kind = struct.unpack_from("<I4s", data, 12)
    assert kind == b"JSON" and size % 4 == 0
    document = json.loads(data[20 : 20 + size])
    rest, kind = struct.unpack_from("<I4s", data, 20 + size)
    assert kind == b"BIN\0" and rest % 4 == 0 and 28 + size + rest == len(data)
    return document, data[28 + size :]


def values(document: dict, blob: bytes, number: int) -> np.ndarray:
    accessor = document["accessors"][number]
    width = {"SCALAR": 1, "VEC3": 3, "VEC4": 4, "MAT4": 16}[accessor["type"]]
    kind = {5126: np.float32, 5123: np.uint16}[accessor["componentType"]]
    start = document["bufferViews"][accessor["bufferView"]].get("byteOffset", 0) + accessor.get("byteOffset", 0)
    array = np.frombuffer(blob, kind, accessor["count"] * width, start).reshape(-1, width)
    if "min" in accessor:
        np.testing.assert_array_equal(array.min(axis=0), accessor["min"])
        np.testing.assert_array_equal(array.max(axis=0), accessor["max"])
    return array


def world_matrices(document: dict, blob: bytes, frame: int | None) -> np.ndarray:
    """World matrices of the skin's joints at a key, or at rest for None, by products of 4 by 4 matrices."""
    nodes = [
        {"translation": node.get("translation", [0, 0, 0]), "rotation": node.get("rotation", [0, 0, 0, 1])}
        for node in document["nodes"]
    ]
    animation = document["animations"][0]
    for channel in animation["channels"] if frame is not None else ():
        sampler = animation["samplers"][channel["sampler"]]
        assert sampler["interpolation"] == "LINEAR"
        nodes[channel["target"]["node"]][channel["target"]["path"]] = values(document, blob, sampler["output"])[frame]
    worlds: dict[int, np.ndarray] = {}

    def visit(number: int, above: np.ndarray) -> None:
        local = np.eye(4)
        x, y, z, w = nodes[number]["rotation"]
        local[:3, :3] = rotation.to_matrix(np.array([w, x, y, z]))
        local[:3, 3] = nodes[number]["translation"]
        worlds[number] = above @ local
        for child in document["nodes"][number].get("children") or ():
            visit(child, worlds[number])

    for root in document["scenes"][0]["nodes"]:
        visit(root, np.eye(4))
    return np.array([worlds[joint] for joint in document["skins"][0]["joints"]])


def check_glb(data: bytes, motion: Motion, frames) -> None:
    document, blob = read_glb(data)
    names = [document["nodes"][joint]["name"] for joint in document["skins"][0]["joints"]]
    assert names == list(motion.skeleton.names)
    expected = kinematics.joint_positions(motion) / 100
    for frame in frames:
        found = world_matrices(document, blob, frame)[:, :3, 3]
        assert np.abs(found - expected[frame]).max() < 1e-4
    inverse = values(document, blob, document["skins"][0]["inverseBindMatrices"]).reshape(-1, 4, 4).transpose(0, 2, 1)
    rest = world_matrices(document, blob, None)
    np.testing.assert_allclose(rest @ inverse, np.tile(np.eye(4), (len(rest), 1, 1)), atol=1e-5)


# --- glTF ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(3))
def test_the_joints_of_a_glb_are_where_they_were(seed):
    motion = random_motion(BRANCHED, 12, seed)
    check_glb(export.to_glb(motion, "clip"), motion, range(12))


def test_keys_are_frames_and_quaternions_do_not_flip():
    motion = random_motion(BRANCHED, 30)
    signs = np.where(np.arange(30) % 2, 1.0, -1.0)[:, None, None]
    motion = Motion(BRANCHED, motion.rotations[:1] * signs, motion.positions, 25.0)
    smooth = tiny.motion(np.random.default_rng(0), 30, BRANCHED)
    moved = Motion(BRANCHED, rotation.multiply(motion.rotations, smooth.rotations), motion.positions, 25.0)
    document, blob = read_glb(export.to_glb(moved, "clip"))
    animation = document["animations"][0]
    for sampler in animation["samplers"]:
        np.testing.assert_allclose(values(document, blob, sampler["input"])[:, 0], np.arange(30) / 25.0, atol=1e-6)
        output = values(document, blob, sampler["output"])
        if output.shape[1] == 4:
            assert (np.sum(output[1:] * output[:-1], axis=1) > 0).all()


def test_only_what_moves_is_animated():
    rotations = np.tile(random_motion(BRANCHED, 1).rotations, (6, 1, 1))
    rotations[:, 3] = random_motion(BRANCHED, 6).rotations[:, 3]
    positions = np.tile(BRANCHED.offsets, (6, 1, 1))
    positions[:, 0, 0] += np.arange(6)
    motion = Motion(BRANCHED, rotations, positions, 30.0)
    data = export.to_glb(motion, "clip")
    targets = [channel["target"] for channel in read_glb(data)[0]["animations"][0]["channels"]]
    assert sorted((t["node"], t["path"]) for t in targets) == [(0, "translation"), (3, "rotation")]
    check_glb(data, motion, range(6))


@pytest.mark.parametrize("count", [1, 3])
def test_one_frame_and_one_joint(count):
    motion = random_motion(chain(count), 1)
    check_glb(export.to_glb(motion, "clip"), motion, [0])


def test_the_mesh_rests_on_the_bones_and_the_library_reads_it(tmp_path):
    data = export.to_glb(random_motion(BRANCHED, 4), "clip")
    document, blob = read_glb(data)
    primitive = document["meshes"][0]["primitives"][0]
    vertices = values(document, blob, primitive["attributes"]["POSITION"])
    joints = values(document, blob, primitive["attributes"]["JOINTS_0"])[:, 0]
    corners = values(document, blob, primitive["indices"])[:, 0].reshape(-1, 3)
    assert corners.max() < len(vertices) and len(vertices) == 6 * 4
    rest = world_matrices(document, blob, None)[:, :3, 3]
    np.testing.assert_allclose(vertices[::6], rest[joints[::6]], atol=1e-6)
    middles = vertices.reshape(-1, 6, 3).mean(axis=1)
    faces = vertices[corners]
    normals = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
    assert (np.sum(normals * (faces.mean(axis=1) - np.repeat(middles, 8, axis=0)), axis=1) > 0).all(), "inside out"
    (tmp_path / "a.glb").write_bytes(data)
    loaded = pygltflib.GLTF2().load(str(tmp_path / "a.glb"))
    assert [node.name for node in loaded.nodes][:5] == list(BRANCHED.names) and len(loaded.binary_blob()) == len(blob)


def test_the_mesh_has_no_bone_from_the_origin_to_the_pelvis():
    names, parents = ["world", *BRANCHED.names], [-1, *(BRANCHED.parents + 1)]
    skeleton = make_skeleton(names, parents, [(0, 0, 0), *BRANCHED.offsets])
    document, blob = read_glb(export.to_glb(random_motion(skeleton, 2), "clip"))
    joints = values(document, blob, document["meshes"][0]["primitives"][0]["attributes"]["JOINTS_0"])
    assert 0 not in joints[:, 0] and len(joints) == 6 * 4


def test_a_real_clip():
    path = next((data_folder() / "bvh/genea_generated").glob("*.bvh"))
    motion = bvh.read(path)
    check_glb(export.to_glb(motion, path.stem), motion, (0, 50, motion.n_frames - 1))


BLENDER = """
import json, sys
try:
    import numpy
except ImportError:
    sys.path.append({numpy!r})
    import numpy
# Blender 3.4's importer says np.bool, which numpy 1.24 of the same Debian has not.
if not hasattr(numpy, "bool"):
    numpy.bool = bool
import bpy
bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.context.scene.render.fps = 30
bpy.ops.import_scene.gltf(filepath={glb!r})
body = next(o for o in bpy.data.objects if o.type == "ARMATURE")
heads = []
for frame in {frames!r}:
    bpy.context.scene.frame_set(frame)
    heads.append({{bone.name: list((body.matrix_world @ bone.matrix).translation) for bone in body.pose.bones}})
json.dump(heads, open({out!r}, "w"))
"""


@pytest.mark.slow
def test_blender_shows_the_same_joints_in_the_same_places(tmp_path):
    """Blender's importer needs numpy; where its Python has none (Debian: python3-numpy), ours is lent to it."""
    blender = shutil.which("blender")
    if blender is None:
        pytest.skip("no `blender` on PATH, so no .glb is opened in it")
    motion = random_motion(BRANCHED, 20)
    frames = [0, 7, 19]
    (tmp_path / "a.glb").write_bytes(export.to_glb(motion, "clip"))
    paths = {"glb": str(tmp_path / "a.glb"), "out": str(tmp_path / "heads.json")}
    numpy_folder = str(Path(np.__file__).parent.parent)
    (tmp_path / "a.py").write_text(BLENDER.format(numpy=numpy_folder, frames=frames, **paths))
    shown = subprocess.run(
        [blender, "--background", "--factory-startup", "--python", str(tmp_path / "a.py")],
        capture_output=True, text=True, timeout=1200,
    )  # fmt: skip
    if "No module named 'numpy" in shown.stdout + shown.stderr or "numpy.core" in shown.stderr:
        pytest.skip("Blender's Python has no numpy and cannot use ours; on Debian, install python3-numpy")
    assert (tmp_path / "heads.json").is_file(), shown.stdout + shown.stderr
    expected = kinematics.joint_positions(motion) / 100
    for frame, heads in zip(frames, json.loads((tmp_path / "heads.json").read_text()), strict=True):
        assert sorted(heads) == sorted(BRANCHED.names)
        for name, (x, y, z) in heads.items():
            # Blender has Z up.
            place = expected[frame, BRANCHED.names.index(name)]
            np.testing.assert_allclose([x, z, -y], place, atol=1e-4)


# --- tables and arrays --------------------------------------------------------------------------------------


def test_csv_has_the_documented_columns():
    motion = random_motion(BRANCHED, 5, fps=20.0)
    header, *rows = csv.reader(export.to_csv(motion).splitlines())
    assert header[:5] == ["frame", "time", "hips.x", "hips.y", "hips.z"] and len(header) == 2 + 3 * 5
    table = np.array(rows, dtype=float)
    np.testing.assert_array_equal(table[:, 0], np.arange(5))
    np.testing.assert_allclose(table[:, 1], np.arange(5) / 20.0)
    np.testing.assert_allclose(table[:, 2:].reshape(5, 5, 3), kinematics.joint_positions(motion), atol=1e-5)


def test_arrays_make_the_same_motion_again():
    motion = random_motion(BRANCHED, 5)
    stored = export.to_arrays(motion)
    again = Motion(BRANCHED, stored["rotations"], stored["local_positions"], float(stored["fps"]))
    np.testing.assert_allclose(kinematics.joint_positions(again), stored["positions"], atol=1e-4)
    assert stored["joint_names"].tolist() == list(BRANCHED.names) and stored["parents"].tolist() == [-1, 0, 1, 2, 0]


# --- the command ----------------------------------------------------------------------------------------------


@pytest.fixture
def takes(tmp_path) -> Path:
    for seed, name in enumerate(("one", "two")):
        bvh.write(tmp_path / "takes" / f"{name}.bvh", random_motion(BRANCHED, 9, seed))
    return tmp_path / "takes"


def test_a_folder_in_all_formats(takes, tmp_path):
    out = tmp_path / "out"
    result = run(takes, "--format", "glb", "--format", "csv", "--format", "npz", "--out", out)
    assert result.exit_code == 0 and "2 motions as glb, csv, npz" in result.output
    assert sorted(p.name for p in out.iterdir()) == [f"{n}.{k}" for n in ("one", "two") for k in ("csv", "glb", "npz")]
    motion = bvh.read(takes / "one.bvh")
    check_glb((out / "one.glb").read_bytes(), motion, (0, 8))
    with np.load(out / "one.npz") as stored:
        np.testing.assert_allclose(stored["positions"], kinematics.joint_positions(motion), atol=1e-4)
    before = {p.name: p.read_bytes() for p in out.iterdir()}
    run(takes, "--format", "glb", "--format", "csv", "--format", "npz", "--out", out)
    assert before == {p.name: p.read_bytes() for p in out.iterdir()}


def test_a_run_is_exported_without_naming_it(takes, tmp_path):
    shutil.copytree(takes, tmp_path / "work/reenact")
    assert run("--work", tmp_path / "work").exit_code == 0
    assert sorted(p.name for p in (tmp_path / "work/export").iterdir()) == ["one.glb", "two.glb"]


def test_a_broken_file_is_one_line_and_the_rest_is_done(takes, tmp_path):
    (takes / "two.bvh").write_text("HIERARCHY")
    result = run(takes, "--format", "csv", "--out", tmp_path / "out")
    assert result.exit_code == 1 and "two.bvh" in result.output
    assert [p.name for p in (tmp_path / "out").iterdir()] == ["one.csv"]


def test_two_motions_of_one_name_are_refused(takes, tmp_path):
    other = shutil.copytree(takes, tmp_path / "other")
    result = run(takes, other / "two.bvh", "--out", tmp_path / "out")
    assert result.exit_code == 1 and "clip two is also" in result.output and not (tmp_path / "out").exists()


def test_without_the_extra_one_line_says_what_to_install(takes, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pygltflib", None)
    result = run(takes, "--out", tmp_path / "out")
    assert result.exit_code == 1 and "pip install 'gesturegen[gltf]'" in result.output
    assert len(result.output.splitlines()) == 1
    assert run(takes, "--format", "csv", "--out", tmp_path / "out").exit_code == 0
