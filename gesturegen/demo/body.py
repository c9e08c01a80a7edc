"""The motion of the demo's whole body: posture sway, head, planted feet, and arms that follow the hand plans."""

from __future__ import annotations

import numpy as np

from gesturegen.demo.curves import Move, bumps, follow, paced_noise, smooth_gate, smooth_noise
from gesturegen.demo.gesture import HandPlan, Stroke, plan_gestures
from gesturegen.demo.limbs import about, align, two_bone
from gesturegen.demo.skeleton import skeleton
from gesturegen.demo.speaker import Speaker
from gesturegen.demo.speech import Script
from gesturegen.motion import rotation
from gesturegen.motion.skeleton import Motion, Skeleton

FPS = 30.0
_SIDES = {"r": -1.0, "l": 1.0}
_FINGERS = ("thumb", "index", "middle", "ring", "pinky")
_DEGREE = np.pi / 180.0
_STEP_FROM = 6.0  # cm, a radian of turn counting as 20
_HANDS_APART = 20.0  # cm between wrists side by side
_JITTER = 0.012 * _DEGREE  # sensor noise per joint and frame


class _Pose:
    """Local rotations under construction `[shape=(T, J, 4)]`, addressed by joint name."""

    def __init__(self, body: Skeleton, n: int):
        self.body = body
        self.rotations = np.tile(rotation.IDENTITY, (n, len(body.names), 1))
        self.root_path = np.zeros((n, 3))

    def set(self, name: str, quaternions: np.ndarray) -> None:
        """Rotate the joint `name` by `quaternions` `[shape=(T, 4)]`."""
        self.rotations[:, self.body.index(name)] = quaternions

    def get(self, name: str) -> np.ndarray:
        """Return the rotations `[shape=(T, 4)]` of the joint `name`."""
        return self.rotations[:, self.body.index(name)]

    def offset(self, name: str) -> np.ndarray:
        """Return the OFFSET of the joint `name` in cm `[shape=(3,)]`."""
        return self.body.offsets[self.body.index(name)]


def make_motion(rng: np.random.Generator, speaker: Speaker, script: Script, n: int) -> Motion:
    """Make the motion of `n` frames at 30 fps: gestures on stressed syllables, hands at rest in the long pauses."""
    hands, strokes = plan_gestures(rng, speaker, script)
    times = np.arange(n) / FPS
    quiet = tuple((start - 0.1, end - 0.1) for start, end in script.rests if end - start > 1.2)
    activity = 0.15 + 0.85 * smooth_gate(times, quiet, 0.5)
    pose = _Pose(skeleton(), n)
    _stand(rng, pose, times, activity)
    _bend_trunk(rng, pose, times, activity, strokes)
    _turn_head(rng, pose, times, activity, script, strokes)
    _plant_feet(pose, *_foot_paths(rng, pose, times))
    paths = _hand_paths(rng, times, hands, activity)
    for side, sign in _SIDES.items():
        _move_arm(rng, pose, side, sign, paths[side], activity)
    moving = np.any(pose.rotations[..., 1:] != 0.0, axis=(0, 2))
    jitter = rotation.from_expmap(rng.normal(0.0, _JITTER, (n, int(moving.sum()), 3)))
    rotations = pose.rotations
    rotations[:, moving] = rotation.multiply(rotations[:, moving], jitter)
    positions = np.tile(pose.body.offsets, (n, 1, 1))
    positions[:, 0] = pose.root_path
    return Motion(pose.body, rotation.normalize(rotations), positions, FPS)


def _stand(rng: np.random.Generator, pose: _Pose, times: np.ndarray, activity: np.ndarray) -> None:
    """Place the pelvis: a position and heading per clip, slow sway, livelier while speaking."""
    n = len(times)
    slow, lively = paced_noise(rng, activity, FPS, 0.08, 6), smooth_noise(rng, n, FPS, 0.5, 6)
    lively *= activity[:, None]
    pose.root_path[:, 0] = rng.uniform(-15.0, 15.0) + 7.0 * slow[:, 0] + 4.2 * lively[:, 0]
    pose.root_path[:, 1] = -0.8 - 0.4 * np.abs(slow[:, 1] + lively[:, 1])
    pose.root_path[:, 2] = rng.uniform(-15.0, 15.0) + 7.0 * slow[:, 2] + 4.0 * lively[:, 2]
    angles = np.array([2.5, 7.0, 1.5]) * slow[:, 3:] + np.array([1.5, 3.0, 1.5]) * lively[:, 3:]
    angles[:, 0] -= 5.0
    # Weight on one leg tilts the pelvis towards the other.
    angles[:, 2] -= 1.2 * lively[:, 0]
    turn = rotation.about_y(np.full(n, rng.normal(0.0, 8.0) * _DEGREE))
    pose.set("b_root", rotation.multiply(turn, rotation.from_expmap(angles * _DEGREE)))


def _bend_trunk(
    rng: np.random.Generator, pose: _Pose, times: np.ndarray, activity: np.ndarray, strokes: list[Stroke]
) -> None:
    """Bend the spine: lean, sway, breathing, and a little of every stroke."""
    n = len(times)
    angles = np.array([3.0, 4.0, 2.5]) * paced_noise(rng, activity, FPS, 0.1, 3)
    angles += np.array([3.0, 5.5, 3.0]) * activity[:, None] * smooth_noise(rng, n, FPS, 0.6, 3)
    centres = np.array([stroke.time for stroke in strokes])
    stress = np.array([stroke.stress for stroke in strokes])
    turns = np.array([{"r": 1.0, "l": -1.0, "rl": 0.0}[stroke.hands] for stroke in strokes])
    angles[:, 0] += bumps(times, centres + 0.05, 2.0 * stress * rng.uniform(0.3, 1.3, len(stress)), 0.16) + 12.0
    angles[:, 1] += bumps(times, centres + 0.05, 3.5 * turns, 0.25)
    breath = 0.5 * np.sin(2.0 * np.pi * (0.26 * times + rng.uniform()))
    shares = {"b_spine0": 0.45, "b_spine1": 0.33, "b_spine2": 0.22}
    for name, share in shares.items():
        own = share * angles
        own[:, 0] -= breath if name == "b_spine2" else 0.0
        pose.set(name, rotation.from_expmap(own * _DEGREE))


def _turn_head(
    rng: np.random.Generator,
    pose: _Pose,
    times: np.ndarray,
    activity: np.ndarray,
    script: Script,
    strokes: list[Stroke],
) -> None:
    """Turn the head: gaze shifts at phrase starts, nods on stress, and slow wandering."""
    n = len(times)
    gaze = []
    for start, _ in script.phrases:
        if rng.random() < 0.7:
            target = rng.normal(0.0, 1.0, 3) * (4.0, 11.0, 3.0)
            gaze.append(Move(start - 0.2, start + rng.uniform(0.3, 0.6), target, np.zeros(3)))
    angles = follow(times, np.zeros(3), gaze)
    angles += smooth_noise(rng, n, FPS, 0.2, 3) * (1.5, 2.5, 1.5)
    angles += activity[:, None] * smooth_noise(rng, n, FPS, 0.9, 3) * (2.2, 3.0, 2.0)
    nods = rng.uniform(1.0, 7.0, len(strokes)) * np.array([stroke.stress for stroke in strokes])
    angles[:, 0] += bumps(times, np.array([stroke.time for stroke in strokes]) + 0.06, nods, 0.11) - 3.0
    for name, share in (("b_neck0", 0.45), ("b_head", 0.55)):
        pose.set(name, rotation.from_expmap(share * angles * _DEGREE))


def _foot_paths(
    rng: np.random.Generator, pose: _Pose, times: np.ndarray
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Plan the ankles `[shape=(T, 3)]` and the turns of the feet `[shape=(T,)]`, by side.

    The feet stay where they stand, and now and then one of them steps a few centimetres.
    """
    heading = rotation.heading(pose.get("b_root"))
    # Where the feet would stand follows the body slowly; a foot steps when it is left behind.
    ground = pose.root_path * (1.0, 0.0, 1.0)
    homes, steps = {}, {}
    for side, sign in _SIDES.items():
        own = np.array([sign * rng.uniform(11.0, 14.0), 7.0, rng.uniform(-6.0, -2.0)])
        place = ground + rotation.rotate(rotation.about_y(heading), own)
        homes[side] = np.column_stack([place, heading + sign * rng.uniform(6.0, 14.0) * _DEGREE])
        steps[side] = [Move(-1.0, 0.0, homes[side][0], np.zeros(4))]
    time = 1.0
    while time < times[-1] - 1.5:
        soon = int((time + 0.5) * FPS)
        misplaced = {side: homes[side][soon] - steps[side][-1].target for side in _SIDES}
        lag = {side: np.linalg.norm(miss[:3]) + 20.0 * abs(miss[3]) for side, miss in misplaced.items()}
        side = max(lag, key=lag.__getitem__)
        if lag[side] > _STEP_FROM:
            arc = np.array([0.0, rng.uniform(1.5, 3.5), 0.0, 0.0])
            steps[side].append(Move(time, time + rng.uniform(0.45, 0.65), homes[side][soon], arc))
        time += rng.uniform(0.7, 1.0)
    paths = {side: follow(times, steps[side][0].target, steps[side][1:]) for side in _SIDES}
    return {side: path[:, :3] for side, path in paths.items()}, {side: path[:, 3] for side, path in paths.items()}


def _plant_feet(pose: _Pose, paths: dict[str, np.ndarray], turns: dict[str, np.ndarray]) -> None:
    """Pose the legs by two-bone kinematics, from the moving pelvis to the standing ankles."""
    down, forward = np.array([0.0, -1.0, 0.0]), np.array([0.0, 0.0, 1.0])
    pelvis = pose.get("b_root")
    centre = pose.root_path + pose.offset("b_root")
    for side in _SIDES:
        thigh, shin = pose.offset(f"b_{side}_leg"), pose.offset(f"b_{side}_foot_twist")
        hip = centre + rotation.rotate(pelvis, pose.offset(f"b_{side}_upleg"))
        toes = rotation.about_y(turns[side])
        pole = rotation.rotate(toes, forward) + 0.0 * hip
        direction, facing, bend = two_bone(
            hip, paths[side], float(np.linalg.norm(thigh)), float(np.linalg.norm(shin)), pole, 0.985
        )
        upleg = align(down, forward, direction, facing)
        # The shin does not hang straight down at rest but leans back by this angle.
        leg = about(0, bend - np.arctan2(-shin[2], -shin[1]))
        pose.set(f"b_{side}_upleg", rotation.multiply(rotation.inverse(pelvis), upleg))
        pose.set(f"b_{side}_leg", leg)
        pose.set(f"b_{side}_foot", rotation.multiply(rotation.inverse(rotation.multiply(upleg, leg)), toes))


def _hand_paths(
    rng: np.random.Generator, times: np.ndarray, hands: dict[str, HandPlan], activity: np.ndarray
) -> dict[str, np.ndarray]:
    """Compute the hand paths `[shape=(T, 10)]` of the plans with drift, clear of the trunk and of each other."""
    n = len(times)
    paths = {}
    for side in _SIDES:
        path = follow(times, hands[side].base, hands[side].moves)
        path[:, :3] += smooth_noise(rng, n, FPS, 0.15, 3) * 0.3
        path[:, :3] += activity[:, None] * smooth_noise(rng, n, FPS, 0.8, 3) * 3.2
        path[:, :3] = _outside_torso(path[:, :3])
        paths[side] = path
    right, left = paths["r"], paths["l"]
    # Outward is to either side, so the hands are x_r + x_l apart; the nearer in height and depth, the more is needed.
    apart = right[:, 0] + left[:, 0]
    beside = np.sum((right[:, 1:3] - left[:, 1:3]) ** 2, axis=1)
    needed = _HANDS_APART * np.exp(-0.5 * beside / 14.0**2)
    push = 1.5 * np.logaddexp(0.0, (needed - apart) / 1.5)
    right[:, 0] += 0.5 * push
    left[:, 0] += 0.5 * push
    return paths


def _move_arm(
    rng: np.random.Generator, pose: _Pose, side: str, sign: float, path: np.ndarray, activity: np.ndarray
) -> None:
    """Pose one arm and its fingers after the hand path `[shape=(T, 10)]` of `shapes.py`."""
    n = len(path)
    target = path[:, :3] * (sign, 1.0, 1.0)
    # The collar bone follows a hand that rises or reaches.
    lift = 0.13 * np.log1p(np.exp((path[:, 1] + 22.0) / 8.0))
    reach = 0.25 * (path[:, 2] - 20.0)
    collar = np.stack([np.zeros(n), -sign * reach, sign * (lift - 1.0) * 3.0], axis=1) * _DEGREE
    shoulder = rotation.from_expmap(collar)
    socket = pose.offset(f"p_{side}_scap") + pose.offset(f"b_{side}_arm")
    start = pose.offset(f"b_{side}_shoulder") + rotation.rotate(shoulder, socket)
    swivel = smooth_noise(rng, n, FPS, 0.25, 1)[:, 0] * 0.10
    pole = np.stack([sign * (0.42 + swivel), np.full(n, -0.75), np.full(n, -0.5)], axis=1)
    upper = abs(pose.offset(f"b_{side}_forearm")[0])
    lower = abs(pose.offset(f"b_{side}_wrist_twist")[0])
    direction, facing, bend = two_bone(start, target, upper, lower, pole, 0.92)
    arm = align(np.array([sign, 0.0, 0.0]), np.array([0.0, 0.0, 1.0]), direction, -facing)
    roll = path[:, 3] + 0.08 * smooth_noise(rng, n, FPS, 0.5, 1)[:, 0] * activity
    wrist_bend = path[:, 4] + 0.06 * smooth_noise(rng, n, FPS, 0.8, 1)[:, 0] * activity
    pose.set(f"b_{side}_shoulder", shoulder)
    pose.set(f"b_{side}_arm", rotation.multiply(rotation.inverse(shoulder), arm))
    pose.set(f"b_{side}_forearm", rotation.multiply(about(1, -sign * bend), about(0, 0.5 * roll)))
    pose.set(f"b_{side}_wrist_twist", about(0, 0.2 * roll))
    pose.set(f"b_{side}_wrist", rotation.multiply(about(0, 0.3 * roll), about(2, -sign * wrist_bend)))
    _curl_fingers(rng, pose, side, sign, path[:, 5:], activity)


def _outside_torso(places: np.ndarray) -> np.ndarray:
    """Push wrist places out of an elliptic cylinder around the trunk, smoothly; x, z in cm from the chest."""
    x, z = places[:, 0], places[:, 2] - 4.0
    radius = np.sqrt((x / 21.0) ** 2 + (z / 16.0) ** 2)
    pushed = 1.0 + 0.05 * np.logaddexp(0.0, (radius - 1.0) / 0.05)
    scale = pushed / np.maximum(radius, 0.2)
    return np.stack([x * scale, places[:, 1], z * scale + 4.0], axis=1)


def _curl_fingers(
    rng: np.random.Generator, pose: _Pose, side: str, sign: float, curls: np.ndarray, activity: np.ndarray
) -> None:
    """Bend the fingers of one hand by their curls `[shape=(T, 5)]` in radians, with a little random movement."""
    noise = smooth_noise(rng, len(curls), FPS, 0.7, 5) * 0.05 * (0.3 + 0.7 * activity[:, None])
    for finger, curl in zip(_FINGERS, (curls + noise).T, strict=True):
        # A thumb folds across the palm, about Y; fingers curl towards it, about Z.
        axis = 1 if finger == "thumb" else 2
        for number, share in ((1, 1.0), (2, 1.1), (3, 0.7)):
            pose.set(f"b_{side}_{finger}{number}", about(axis, -sign * share * curl))
