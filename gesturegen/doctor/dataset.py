"""The examination of a whole data set: how its recordings differ, and what each method could do with them."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping, Sequence

from gesturegen.doctor.examination import Examined
from gesturegen.frames import offset_tolerance
from gesturegen.inputs import shown
from gesturegen.joints import settings_for
from gesturegen.methods import METHODS
from gesturegen.methods.method import Material
from gesturegen.motion.skeleton import Skeleton
from gesturegen.remembered import changed_yaml
from gesturegen.settings.models import Config


def _difference(one: Skeleton, other: Skeleton, config: Config) -> str | None:
    """Describe what keeps recordings of two skeletons from sharing a graph; None where nothing does."""
    return one.difference(other, offset_tolerance(one, config))


def compare(examined: Mapping[str, Examined], config: Config) -> None:
    """Add to each recording with motion how it differs from most others: skeleton and frame rate."""
    having = [
        (one, one.skeleton, one.fps)
        for _, one in sorted(examined.items())
        if one.skeleton is not None and one.fps is not None
    ]
    if len(having) < 2:
        return
    groups: list[tuple[Skeleton, list[Examined]]] = []
    for one, skeleton, _ in having:
        group = next((members for first, members in groups if _difference(first, skeleton, config) is None), None)
        groups.append((skeleton, [one])) if group is None else group.append(one)
    usual, most = max(groups, key=lambda group: len(group[1]))
    for skeleton, members in groups:
        if members is not most:
            what = _difference(usual, skeleton, config)
            for one in members:
                one.add(
                    "other skeleton",
                    f"another skeleton than {len(most)} of {len(having)}: {what}",
                    "use each skeleton's recordings by themselves, or retarget",
                )
    rates = Counter(round(fps, 3) for _, _, fps in having)
    rate, _ = max(rates.items(), key=lambda item: (item[1], -item[0]))
    for one, _, fps in having:
        if abs(fps - rate) > 1e-3 * rate:
            one.add(
                "frame rate",
                f"{fps:g} fps, {rates[rate]} of {len(having)} have {rate:g}",
                "none is needed: it is resampled",
            )


def methods(
    references: Sequence[Examined], tests: Sequence[Examined], n_true: int, config: Config
) -> list[tuple[str, str, str]]:
    """List what each method could do with the data: name, `yes`, `limited` or `no`, and why.

    n_true : tests whose true motion is known
    """
    fit = [one for one in references if not one.unfit and one.skeleton is not None]
    minutes = sum(one.seconds or 0 for one in fit) / 60
    base = f"{len(fit)} of {len(references)} references, {minutes:.1f} min"
    nothing = "no" if not fit or not tests else None
    why = "no reference is left" if not fit else "no test speech" if not tests else ""
    onsets = all((one.onset_rate or 0) > 0 for one in fit)
    clips = sum(one.gesture_clips for one in fit)
    shared = sorted({word for one in fit for word in one.keywords} & {word for one in tests for word in one.keywords})
    skeleton = fit[0].skeleton if fit else None
    names = frozenset(skeleton.names) if skeleton is not None else frozenset()
    own = settings_for(skeleton, config) if skeleton is not None else config
    material = Material(base, minutes, onsets, clips, len(shared), names, own)
    rows = [
        (what, nothing or able, why or because)
        for method in METHODS.values()
        for what, able, because in method.prospects(material)
    ]
    hands = sorted({own.control.left, own.control.right} - names)
    rows.append(
        (
            "control of the hands",
            nothing or ("no" if hands else "yes"),
            why
            or (
                f"the skeleton lacks {', '.join(hands)}; give control.left and control.right"
                if hands
                else "both hands are there"
            ),
        )
    )
    speakers = {one.speaker for one in fit} - {None}
    served = sum(one.speaker in speakers for one in tests)
    rows.append(
        (
            "references.mode: speaker",
            nothing or ("yes" if served == len(tests) else "limited" if served else "no"),
            why or f"{served} of {len(tests)} tests have a reference of their speaker in metadata.csv",
        )
    )
    rows.append(
        (
            "evaluate against the truth",
            "yes" if tests and n_true == len(tests) else "limited" if n_true else "no",
            f"the true motion of {n_true} of {len(tests)} tests is there",
        )
    )
    return rows


def blacklist_yaml(references: Sequence[Examined], plain: Mapping[str, str], config: Config | None = None) -> str:
    """Format a config that leaves out what is unfit, and why, line by line.

    plain : recording -> its clip's name

    config : whose other settings go into it, without which it would stand for the defaults
    """
    lines = [
        "# What `gesturegen doctor` would leave out of the references, and why, with the settings that it was run with.",
        "# Use it with --config, or copy it into your own config.",
    ]
    config = config or Config()
    lines += changed_yaml(config, ("blacklist", "exclude")).splitlines()
    whole = [one for one in references if one.unfit]
    lines.append("blacklist:" if whole or config.blacklist else "blacklist: []")
    lines += [f"- {json.dumps(pattern, ensure_ascii=False)}  # as before" for pattern in config.blacklist]
    for one in whole:
        reasons = _comment("; ".join(f.text for f in one.findings if f.start is None))
        lines.append(f"- {json.dumps(plain[one.name], ensure_ascii=False)}  # {reasons}")
    ranges = [(one, f) for one in references if not one.unfit for f in one.findings if f.start is not None]
    lines.append("exclude:" if ranges or config.exclude else "exclude: []")
    lines += [
        f"- {{clip: {json.dumps(old.clip, ensure_ascii=False)}, from: {old.from_:g}, to: {old.to:g}}}  # as before"
        for old in config.exclude
    ]
    for one, f in ranges:
        lines.append(
            f"- {{clip: {json.dumps(plain[one.name], ensure_ascii=False)}, from: {f.start:.2f}, to: {f.end:.2f}}}  # {_comment(f.text)}"
        )
    return "\n".join(lines) + "\n"


def _comment(text: str) -> str:
    """Format a text on one line, so that it may stand behind a `#`."""
    return shown(" ".join(text.split()))
