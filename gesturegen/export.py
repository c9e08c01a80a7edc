"""Export of motion to other programs: glTF 2.0 (`.glb`), CSV of joint positions, and plain arrays.

glTF is in metres and BVH in centimetres, so lengths are divided by 100. Both have Y up and the same handedness.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from gesturegen import __version__, files
from gesturegen.extras import need
from gesturegen.motion import kinematics, rotation
from gesturegen.motion.skeleton import Motion

CENTIMETRES_PER_METRE = 100.0
# Below these a joint is at rest: the rounding of BVH files, in centimetres and in quaternion components.
_STILL_POSITION, _STILL_ROTATION = 1e-5, 1e-7
_FLOAT, _USHORT = 5126, 5123
_ARRAY_BUFFER, _ELEMENT_BUFFER = 34962, 34963


@dataclass(frozen=True)
class Format:
    """A file format of motions.

    encode : the content of a file, of a motion, its name and the name of its pelvis joint (`to_glb`)
    needs : the package and the extra without which there is no such file; None where nothing is needed
    """

    encode: Callable[[Motion, str, str], bytes]
    needs: tuple[str, str] | None = None


def write(path: Path, motion: Motion, name: str, pelvis: str = "") -> None:
    """Write a motion in the format of the file's ending, one of `FORMATS`, all or nothing.

    name, pelvis : of `to_glb`
    """
    data = FORMATS[path.suffix.lower().removeprefix(".")].encode(motion, name, pelvis)
    files.write_bytes(path, lambda file: file.write(data))


def to_arrays(motion: Motion) -> dict[str, np.ndarray]:
    """Collect the arrays of the `.npz`: world positions, local rotations (wxyz) and positions, and the skeleton."""
    skeleton = motion.skeleton
    return {
        "positions": kinematics.joint_positions(motion).astype(np.float32),
        "rotations": continuous(motion.rotations),
        "local_positions": np.asarray(motion.positions),
        "joint_names": np.array(skeleton.names),
        "parents": np.asarray(skeleton.parents),
        "offsets": np.asarray(skeleton.offsets),
        "fps": np.array(motion.fps),
    }


def to_csv(motion: Motion) -> str:
    """Format world positions of all joints in cm, y up, one line per frame: `frame,time,<joint>.x,...`."""
    positions = kinematics.joint_positions(motion).reshape(motion.n_frames, -1)
    header = io.StringIO()
    names = [f"{name}.{axis}" for name in motion.skeleton.names for axis in "xyz"]
    csv.writer(header, lineterminator="\n").writerow(["frame", "time", *names])
    form = "%d,%.6f" + ",%.5f" * positions.shape[1] + "\n"
    return header.getvalue() + "".join(
        form % (frame, frame / motion.fps, *row) for frame, row in enumerate(positions.tolist())
    )


def continuous(quaternions: np.ndarray) -> np.ndarray:
    """Choose signs of quaternions `[shape=(T, ..., 4)]` that never flip from one frame to the next.

    q and -q turn alike, but halfway between them lies something else.
    """
    flips = np.sum(quaternions[1:] * quaternions[:-1], axis=-1) < 0
    signs = np.where(np.cumsum(flips, axis=0) % 2, -1.0, 1.0)
    return np.concatenate([quaternions[:1], quaternions[1:] * signs[..., None]])


# --- glTF ---------------------------------------------------------------------------------------------------


def to_glb(motion: Motion, name: str, pelvis: str = "") -> bytes:
    """Make a binary glTF 2.0 file: a node per joint, an animation, and a mesh skinned to the joints.

    pelvis : name of the joint that the mesh begins at
    Joints that turn have a rotation sampler and rest unturned; joints that move have a translation sampler.
    Others rest where they always are. Interpolation is LINEAR, the key of frame k stands at k / fps.
    """
    gltf = need("pygltflib", "gltf")
    skeleton, count = motion.skeleton, len(motion.skeleton.names)
    turns = np.abs(motion.rotations - motion.rotations[:1]).max(axis=(0, 2)) > _STILL_ROTATION
    moves = np.abs(motion.positions - motion.positions[:1]).max(axis=(0, 2)) > _STILL_POSITION
    rest_rotations = np.where(turns[:, None], rotation.IDENTITY, motion.rotations[0])
    rest_positions = np.where(moves[:, None], skeleton.offsets, motion.positions[0])
    rest = Motion(skeleton, rest_rotations[None], rest_positions[None], motion.fps)
    nodes = [
        gltf.Node(
            name=skeleton.names[j],
            translation=(rest_positions[j] / CENTIMETRES_PER_METRE).tolist(),
            rotation=_xyzw(rest_rotations[j]).tolist(),
            children=skeleton.children(j) or None,
        )
        for j in range(count)
    ]
    nodes.append(gltf.Node(name=f"{name} mesh", mesh=0, skin=0))
    data = _Buffer(gltf)
    mesh = _add_mesh(gltf, data, rest, name, pelvis)
    skin = _add_skin(gltf, data, rest, name)
    document = gltf.GLTF2(
        asset=gltf.Asset(version="2.0", generator=f"gesturegen {__version__}"),
        scene=0,
        scenes=[gltf.Scene(name=name, nodes=[0, count])],
        nodes=nodes,
        meshes=[mesh],
        skins=[skin],
        materials=[gltf.Material(name="body", pbrMetallicRoughness=gltf.PbrMetallicRoughness(
            baseColorFactor=[0.35, 0.45, 0.55, 1.0], metallicFactor=0.0, roughnessFactor=0.8))],
        animations=[_animation(gltf, data, motion, turns, moves, name)],
        accessors=data.accessors,
        bufferViews=data.views,
        buffers=[gltf.Buffer(byteLength=len(data.bytes))],
    )  # fmt: skip
    document.set_binary_blob(bytes(data.bytes))
    return b"".join(document.save_to_bytes())


def _xyzw(quaternions: np.ndarray) -> np.ndarray:
    """Move the real part of quaternions to the end, where glTF keeps it."""
    return np.asarray(quaternions)[..., [1, 2, 3, 0]]


class _Buffer:
    """The binary part of a `.glb`, and the accessors that describe it."""

    def __init__(self, gltf: ModuleType):
        self.gltf, self.bytes = gltf, bytearray()
        self.views: list[Any] = []
        self.accessors: list[Any] = []

    def add(self, array: np.ndarray, kind: str, target: int | None = None, bounds: bool = False) -> int:
        """Append float32 or uint16 rows `[shape=(n, width)]` and return the number of their accessor.

        kind : glTF's name of a row, such as VEC3; bounds : whether to state the least and greatest values,
        which glTF demands of key times and vertex positions
        """
        array = np.ascontiguousarray(array)
        view = self.gltf.BufferView(buffer=0, byteOffset=len(self.bytes), byteLength=array.nbytes, target=target)
        accessor = self.gltf.Accessor(
            bufferView=len(self.views),
            componentType=_FLOAT if array.dtype == np.float32 else _USHORT,
            count=len(array),
            type=kind,
        )
        if bounds:
            accessor.min, accessor.max = (np.atleast_1d(f(array, axis=0)).tolist() for f in (np.min, np.max))
        self.bytes += array.tobytes()
        self.bytes += bytes(-len(self.bytes) % 4)
        self.views.append(view)
        self.accessors.append(accessor)
        return len(self.accessors) - 1


def _animation(gltf: ModuleType, data: _Buffer, motion: Motion, turns: np.ndarray, moves: np.ndarray, name: str) -> Any:
    """Make the animation: a track for each joint that turns or moves."""
    times = data.add((np.arange(motion.n_frames) / motion.fps).astype(np.float32), "SCALAR", bounds=True)
    rotations = _xyzw(continuous(motion.rotations)).astype(np.float32)
    positions = (motion.positions / CENTIMETRES_PER_METRE).astype(np.float32)
    # An animation needs a channel, even one of a body that stands still.
    tracks = [(j, "rotation", rotations[:, j], "VEC4") for j in np.flatnonzero(turns).tolist()]
    tracks += [(j, "translation", positions[:, j], "VEC3") for j in np.flatnonzero(moves).tolist()]
    samplers, channels = [], []
    for joint, path, values, kind in tracks or [(0, "translation", positions[:, 0], "VEC3")]:
        samplers.append(gltf.AnimationSampler(input=times, output=data.add(values, kind), interpolation="LINEAR"))
        target = gltf.AnimationChannelTarget(node=joint, path=path)
        channels.append(gltf.AnimationChannel(sampler=len(samplers) - 1, target=target))
    return gltf.Animation(name=name, samplers=samplers, channels=channels)


def _add_skin(gltf: ModuleType, data: _Buffer, rest: Motion, name: str) -> Any:
    """Add the skin: all joints, and the matrices that take the resting mesh to each of them."""
    rotations, positions = (array[0] for array in kinematics.world_transforms(rest))
    inverse = np.tile(np.eye(4), (len(positions), 1, 1))
    inverse[:, :3, :3] = rotation.to_matrix(rotation.inverse(rotations))
    inverse[:, :3, 3] = -rotation.rotate(rotation.inverse(rotations), positions / CENTIMETRES_PER_METRE)
    # glTF stores matrices column by column.
    columns = inverse.transpose(0, 2, 1).reshape(-1, 16).astype(np.float32)
    return gltf.Skin(
        name=name, joints=list(range(len(positions))), skeleton=0, inverseBindMatrices=data.add(columns, "MAT4")
    )


def _add_mesh(gltf: ModuleType, data: _Buffer, rest: Motion, name: str, pelvis: str) -> Any:
    """Add the mesh: a double pyramid along every bone, each bound to the bone's upper joint alone."""
    vertices, owners, triangles = _double_pyramids(rest, pelvis)
    weights = np.zeros((len(vertices), 4), dtype=np.float32)
    weights[:, 0] = 1.0
    joints = np.zeros((len(vertices), 4), dtype=np.uint16)
    joints[:, 0] = owners
    attributes = gltf.Attributes(
        POSITION=data.add(vertices, "VEC3", _ARRAY_BUFFER, bounds=True),
        JOINTS_0=data.add(joints, "VEC4", _ARRAY_BUFFER),
        WEIGHTS_0=data.add(weights, "VEC4", _ARRAY_BUFFER),
    )
    indices = data.add(triangles.astype(np.uint16), "SCALAR", _ELEMENT_BUFFER)
    return gltf.Mesh(name=name, primitives=[gltf.Primitive(attributes=attributes, indices=indices, material=0)])


def _double_pyramids(rest: Motion, pelvis: str = "") -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Make a double pyramid for every bone.

    Returns vertices in metres `[shape=(V, 3)]` float32, their joints `[shape=(V,)]`, and corners of triangles
    `[shape=(3 F,)]`.
    """
    positions = kinematics.joint_positions(rest)[0] / CENTIMETRES_PER_METRE
    bones = [(int(p), j) for j, p in enumerate(rest.skeleton.parents) if p >= 0]
    # What leads from the world's origin to the pelvis is no part of the body.
    body = rest.skeleton.descendants(rest.skeleton.pelvis(pelvis))
    bones = [bone for bone in bones if bone[1] in body] or bones
    bones = [(a, b) for a, b in bones if np.linalg.norm(positions[b] - positions[a]) > 1e-4]
    # A joint alone gets a small one, straight up.
    spans = [(a, positions[a], positions[b]) for a, b in bones] or [(0, positions[0], positions[0] + [0, 0.05, 0])]
    faces = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 1], [5, 2, 1], [5, 3, 2], [5, 4, 3], [5, 1, 4]])
    vertices, owners, triangles = [], [], []
    for k, (joint, start, end) in enumerate(spans):
        along = end - start
        # Any direction across will do; the axis least along the bone gives a safe one.
        across = np.cross(along, np.eye(3)[np.abs(along).argmin()])
        across *= 0.12 * np.linalg.norm(along) / np.linalg.norm(across)
        other = np.cross(along, across) / np.linalg.norm(along)
        waist = start + 0.2 * along
        vertices += [start, waist + across, waist + other, waist - across, waist - other, end]
        owners += [joint] * 6
        triangles.append(faces[:, ::-1] + 6 * k)
    return np.array(vertices, dtype=np.float32), np.array(owners), np.concatenate(triangles).ravel()


def _npz(motion: Motion, _name: str, _pelvis: str) -> bytes:
    """Encode a motion as an uncompressed `.npz`."""
    content = io.BytesIO()
    np.savez(content, **to_arrays(motion))
    return content.getvalue()


def _csv(motion: Motion, _name: str, _pelvis: str) -> bytes:
    """Encode a motion as a table of joint positions."""
    return to_csv(motion).encode()


# By the endings of files, for `export --format`, `Gesture.export` and `write`.
FORMATS = {
    "glb": Format(to_glb, ("pygltflib", "gltf")),
    "csv": Format(_csv),
    "npz": Format(_npz),
}
