"""Commands killed at random moments of every stage, with every recommended config, and started again."""

import signal
from itertools import count

import numpy as np
import pytest

from tests.faults import cases, faulty
from tests.faults.cases import CONFIGS, STAGES
from tests.faults.faulty import Fault

pytestmark = pytest.mark.slow
ROUNDS = 3  # each of a kill in each of five stages with each of four configs: 60 kills
SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGKILL, signal.SIGINT, signal.SIGHUP)
CODES = {signal.SIGTERM: 143, signal.SIGINT: 130, signal.SIGHUP: 129, signal.SIGKILL: -signal.SIGKILL}


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    return cases.write_data(tmp_path_factory.mktemp("faults") / "data")


@pytest.mark.parametrize("config", CONFIGS)
def test_a_killed_run_goes_on_and_ends_in_the_same_bytes(config, data, tmp_path):
    calm, log = tmp_path / "calm", tmp_path / "log"
    whole = faulty.run_with(cases.arguments(config, data, calm), calm, log)
    assert whole.code == 0, whole.output
    rng = np.random.default_rng([11, list(CONFIGS).index(config)])
    folders = (tmp_path / f"work{number}" for number in count())
    for _ in range(ROUNDS):
        work = next(folders)
        for stage, written in STAGES.items():
            fault = random_fault(rng, written, whole.changes)
            ended = faulty.run_with(cases.arguments(config, data, work), work, log, fault)
            assert ended.struck, f"{stage} made fewer changes than in the first run: {fault} {ended}"
            complain(ended, fault)
            if ended.code == 0:  # only a worker died, and another one did its task
                faulty.same(work, calm)
                work = next(folders)
        last = faulty.run_with(cases.arguments(config, data, work), work, log)
        assert last.code == 0 and last.output == "", last.output
        faulty.same(work, calm)


def random_fault(rng: np.random.Generator, folders, changes) -> Fault:
    """A kill anywhere in a stage that has not begun yet, so that its changes are those of the first run."""
    written = [folder for folder in folders if folder in changes]
    folder = written[rng.integers(len(written))]
    return Fault(
        (folder,),
        int(rng.integers(1, changes[folder] + 1)),
        ("self", "command")[rng.integers(2)],
        int(SIGNALS[rng.integers(len(SIGNALS))]),
    )


def complain(ended: faulty.Ended, fault: Fault) -> None:
    """A command that was killed says so in plain lines, unless it was given no time to."""
    lines = faulty.told(ended)
    if fault.target == "command":
        assert ended.code == CODES[fault.signal], ended
    assert lines or ended.code in (0, -signal.SIGKILL), ended
