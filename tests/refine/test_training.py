import numpy as np
import pytest

torch = pytest.importorskip("torch")

from gesturegen.errors import DataError  # noqa: E402
from gesturegen.refine import checkpoints, training  # noqa: E402
from gesturegen.refine.network import Critic, Generator  # noqa: E402
from gesturegen.refine.representation import Description  # noqa: E402
from gesturegen.refine.training import Pairs  # noqa: E402
from gesturegen.settings.models import Refiner  # noqa: E402
from tests.builders import refused  # noqa: E402

TWO = Description(("left", "right"), 15.0)
# A learning rate ten times the text's: these runs are short.
QUICK = Refiner(iterations=4, batch=4, check_every=2, learning_rate=1e-3, device="cpu")


def smooth(rng, *shape):
    """Noise over time, averaged over five frames."""
    values = rng.normal(size=(*shape[:-1], shape[-1] + 4))
    return sum(values[..., n : n + shape[-1]] for n in range(5)) / np.sqrt(5)


def make_pairs(windows=24, frames=16, planted=True, groups=4, seed=0):
    """Gestures of which four sounds move every channel, or, if not planted, something that is not heard."""
    rng = np.random.default_rng(seed)
    audio, fake = smooth(rng, windows, 28, frames), smooth(rng, windows, TWO.channels, frames)
    weights = rng.normal(size=(TWO.channels, 4)) / 2
    drive = audio if planted else smooth(rng, windows, 28, frames)
    real = fake + np.einsum("ca,kat->kct", weights, drive[:, :4])
    parts = (part.astype(np.float32) for part in (audio, fake, real))
    return Pairs(*parts, np.arange(windows) * groups // windows)


PAIRS = make_pairs()


def equal(one, other):
    """Are two checkpoints the same, bit by bit?"""
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(equal(one[key], other[key]) for key in one)
    if isinstance(one, (list, tuple)):
        return len(one) == len(other) and all(equal(a, b) for a, b in zip(one, other, strict=True))
    if isinstance(one, torch.Tensor):
        return torch.equal(one, other)
    return one == other


class Killed(Exception):
    pass


def killed_after(iteration):
    def progress(done, history):
        if done == iteration:
            raise Killed

    return progress


# --- losses -------------------------------------------------------------------------------------------------


def test_slopes_of_a_critic_with_known_gradient():
    weights = torch.tensor([[3.0, 0.0], [0.0, 4.0]], requires_grad=True)
    audio, gesture = torch.zeros(3, 1, 2), torch.arange(12.0).reshape(3, 2, 2)
    scores, norms = training.scores_and_slopes(lambda a, g: (g * weights).sum(dim=(1, 2)), audio, gesture)
    torch.testing.assert_close(scores, (gesture * weights).sum(dim=(1, 2)))
    torch.testing.assert_close(norms, torch.full((3,), 5.0))
    penalty = training.gradient_penalty(norms)
    assert penalty.item() == pytest.approx(16.0)
    # d (|w| - 1)^2 / dw = 2 (|w| - 1) w / |w|
    penalty.backward()
    torch.testing.assert_close(weights.grad, 8.0 * weights.detach() / 5.0)


def test_slopes_are_taken_window_by_window_and_not_by_the_audio():
    audio, gesture = torch.randn(4, 3, 5), torch.randn(4, 2, 5)
    _, norms = training.scores_and_slopes(
        lambda a, g: (g**2).sum(dim=(1, 2)) / 2 + 9 * a.sum(dim=(1, 2)), audio, gesture
    )
    torch.testing.assert_close(norms, gesture.flatten(1).norm(dim=1))


def test_losses_by_hand():
    settings = Refiner(w_reconstruction=0.1, w_adversarial=2.0, w_penalty=100.0)
    real, refined, norms = torch.tensor([3.0, 5.0]), torch.tensor([1.0, 2.0]), torch.tensor([1.0, 1.2])
    assert training.critic_loss(real, refined, norms, settings).item() == pytest.approx(2 * (1.5 - 4.0) + 100 * 0.02)
    gesture = torch.zeros(2, 3, 4)
    # Three channels off by 2 in every frame.
    assert training.reconstruction(gesture, gesture - 2.0).item() == pytest.approx(6.0)
    loss = training.generator_loss(refined, gesture, gesture - 2.0, settings)
    assert loss.item() == pytest.approx(0.1 * 6.0 - 2 * 1.5)


def test_each_player_moves_the_scores_its_way():
    torch.manual_seed(0)
    audio, fake, real = (torch.from_numpy(part[:8].copy()) for part in (PAIRS.audio, PAIRS.fake, PAIRS.real))
    generator, critic = Generator(28, TWO.channels), Critic(28, TWO.channels)
    settings = Refiner(w_reconstruction=0.0, w_penalty=0.0)

    def gap():
        refined = generator(audio, fake).detach()
        return (critic(audio, real).mean() - critic(audio, refined).mean()).item()

    before = gap()
    refined = generator(audio, fake).detach()
    _, norms = training.scores_and_slopes(critic, audio, refined)
    training.critic_loss(critic(audio, real), critic(audio, refined), norms, settings).backward()
    torch.optim.Adam(critic.parameters(), lr=1e-4).step()
    assert gap() > before

    before = critic(audio, generator(audio, fake)).mean().item()
    refined = generator(audio, fake)
    generator.zero_grad()
    training.generator_loss(critic(audio, refined), fake, refined, settings).backward()
    torch.optim.Adam(generator.parameters(), lr=1e-4).step()
    assert critic(audio, generator(audio, fake)).mean().item() > before


# --- runs ---------------------------------------------------------------------------------------------------


def run(path, settings=QUICK, pairs=PAIRS, seed=0, **options):
    history = training.train(pairs, settings, seed, path, TWO, **options)
    return history, checkpoints.load(path)


def stored(state, path) -> None:
    with open(path, "w+b") as file:
        checkpoints.store(state, file)


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    path = tmp_path_factory.mktemp("refiner") / "refiner.pt"
    return path, *run(path)


@pytest.mark.slow
def test_the_same_run_twice_gives_the_same_bits(trained, tmp_path):
    torch.manual_seed(99)
    _, history, state = trained
    again, other = run(tmp_path / "again.pt")
    assert equal(state, other)
    assert vars(again) == vars(history)
    assert history.checks == [2, 4]
    assert history.iterations == 4
    _, other = run(tmp_path / "other.pt", seed=1)
    assert not equal(state["generator"], other["generator"])


@pytest.mark.slow
def test_torch_is_left_as_it_was(tmp_path):
    torch.manual_seed(5)
    expected = torch.rand(3)
    torch.manual_seed(5)
    threads = torch.get_num_threads()
    run(tmp_path / "r.pt", QUICK.model_copy(update={"iterations": 1}))
    assert torch.equal(torch.rand(3), expected)
    assert torch.get_num_threads() == threads


@pytest.mark.parametrize("iteration", [1, 2, 3])
@pytest.mark.slow
def test_a_killed_run_taken_up_again_gives_the_same_bits(trained, tmp_path, iteration):
    """Killed before the first checkpoint, right after it, and with work since that is lost."""
    _, history, state = trained
    path = tmp_path / "r.pt"
    with pytest.raises(Killed):
        run(path, progress=killed_after(iteration))
    assert path.exists() == (iteration >= 2)
    resumed, other = run(path)
    assert equal(state, other)
    assert vars(resumed) == vars(history)


@pytest.mark.slow
def test_a_run_can_go_on_for_longer(trained, tmp_path):
    _, _, state = trained
    path = tmp_path / "r.pt"
    run(path, QUICK.model_copy(update={"iterations": 2}))
    _, other = run(path)
    assert equal(state | {"settings": {}}, other | {"settings": {}})


@pytest.mark.slow
def test_a_finished_run_is_not_run_again(trained):
    path, history, _ = trained
    before = path.read_bytes()
    again, _ = run(path, progress=killed_after(5))
    assert vars(again) == vars(history)
    assert path.read_bytes() == before


@pytest.mark.slow
def test_a_checkpoint_is_written_all_or_nothing(tmp_path, monkeypatch):
    path = tmp_path / "r.pt"
    with pytest.raises(Killed):
        run(path, progress=killed_after(2))
    before = path.read_bytes()

    def half(state, file):
        file.write(b"half")
        raise Killed

    with monkeypatch.context() as patch:
        patch.setattr(training.torch, "save", half)
        with pytest.raises(Killed):
            run(path)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.slow
def test_resume_off_starts_over(trained, tmp_path):
    _, _, state = trained
    path = tmp_path / "r.pt"
    path.write_bytes(b"not a checkpoint")
    _, other = run(path, resume=False)
    assert equal(state, other)


@pytest.mark.slow
def test_training_stops_when_the_figure_no_longer_falls(tmp_path, monkeypatch):
    figures = iter([5.0, 3.0, 4.0, 3.0, 6.0, 1.0])
    monkeypatch.setattr(training, "held_out_figure", lambda *_: next(figures))
    kept = []

    def progress(done, history):
        kept.append(done)

    settings = QUICK.model_copy(update={"iterations": 100, "check_every": 1, "patience": 3})
    history, state = run(tmp_path / "r.pt", settings, progress=progress)
    assert history.stopped
    assert history.figures == [5.0, 3.0, 4.0, 3.0, 6.0]
    assert kept[-1] == 5
    assert history.checks[history.best] == 2
    assert not equal(state["best"]["generator"], state["generator"])
    # The best weights are those that two iterations give.
    figures = iter([5.0, 3.0])
    _, short = run(tmp_path / "short.pt", settings.model_copy(update={"iterations": 2}))
    assert equal(short["generator"], state["best"]["generator"])
    assert equal(short["critic"], state["best"]["critic"])


@pytest.mark.slow
def test_the_slope_of_the_critic_starts_at_one(trained):
    _, history, _ = trained
    assert history.gradient_norm[0] == pytest.approx(1.0, abs=0.25)


# --- held-out windows ---------------------------------------------------------------------------------------


def test_whole_recordings_are_held_out():
    groups = np.repeat(np.arange(20), 5)
    train, held_out = training._split(groups, 0.1, seed=3)
    assert len(held_out) == 10
    assert len(set(groups[held_out])) == 2
    assert not set(groups[held_out]) & set(groups[train])
    assert len(train) + len(held_out) == 100
    assert not np.array_equal(held_out, training._split(groups, 0.1, seed=4)[1])


@pytest.mark.parametrize("share", [0.001, 0.999])
@pytest.mark.parametrize("recordings", [1, 2, 7])
def test_something_is_held_out_and_something_is_left(share, recordings):
    train, held_out = training._split(np.arange(14) * recordings // 14, share, seed=0)
    assert len(train) >= 1
    assert len(held_out) >= 1


def test_of_one_recording_the_end_is_held_out():
    _, held_out = training._split(np.zeros(50, dtype=int), 0.1, seed=0)
    assert held_out.tolist() == [45, 46, 47, 48, 49]


def test_one_window_is_not_enough(tmp_path):
    with refused(DataError, "1 windows to train on; at least 2"):
        run(tmp_path / "r.pt", pairs=PAIRS.take([0]))


def test_the_figure_is_one_for_the_input_nought_for_the_real_thing_and_not_mended_by_noise():
    torch.manual_seed(0)
    audio, fake = torch.randn(60, 28, 32), torch.randn(60, 6, 32).cumsum(dim=2)
    real = fake + 2 * audio[:, :6]
    none = Refiner(w_reconstruction=0.0)
    assert training.held_out_figure(audio, fake, fake, real, none) == 1.0
    assert training.held_out_figure(audio, fake, real, real, none) == 0.0
    assert training.held_out_figure(audio, fake, real, real, Refiner(w_reconstruction=0.5)) == pytest.approx(
        0.5 * float((real - fake).abs().mean())
    )
    assert training.held_out_figure(audio, fake, fake + audio[:, :6], real, none) < 0.8
    assert training.held_out_figure(audio, fake, fake + 2 * torch.randn_like(fake), real, none) > 0.95
    # The same corrections to other speech.
    other = fake + 2 * audio.roll(1, dims=0)[:, :6]
    assert training.held_out_figure(audio, fake, other, real, none) > 0.95


def test_a_knn_that_is_right_already_has_a_finite_figure():
    audio, fake = torch.randn(4, 28, 16), torch.randn(4, 6, 16)
    assert training.held_out_figure(audio, fake, fake, fake, Refiner()) == 0.0


# --- checkpoints --------------------------------------------------------------------------------------------


def use(path, description=TWO, frames=40):
    return training.refine(path, np.zeros((28, frames)), np.zeros((description.channels, frames)), description)


@pytest.mark.slow
def test_refining_a_sequence_of_any_length(trained):
    path, _, _ = trained
    for frames in (3, 16, 101):
        refined = use(path, frames=frames)
        assert refined.shape == (TWO.channels, frames)
        assert refined.dtype == np.float64
    assert np.array_equal(use(path), use(path))


@pytest.mark.slow
def test_a_refiner_that_corrects_nothing_gives_back_its_input(trained, tmp_path):
    """So channels are scaled going in and scaled back coming out."""
    _, _, state = trained
    best = dict(state["best"]["generator"])
    for name in ("up.3.1.weight", "up.3.1.bias"):
        best[name] = torch.zeros_like(best[name])
    stored(state | {"best": state["best"] | {"generator": best}}, tmp_path / "r.pt")
    gesture = np.random.default_rng(0).normal(size=(TWO.channels, 30))
    refined = training.refine(tmp_path / "r.pt", np.ones((28, 30)), gesture, TWO)
    np.testing.assert_allclose(refined, gesture, atol=1e-5)


@pytest.mark.parametrize(
    ("description", "difference"),
    [
        (Description(("left",), 15.0), r"2 joints \(12 channels\) against 1 \(6\)"),
        (Description(("left", "tail"), 15.0), "joint 'right' against 'tail'"),
        (Description(("left", "right"), 30.0), "15 frames per second against 30"),
    ],
)
@pytest.mark.slow
def test_a_checkpoint_of_another_skeleton_is_refused(trained, description, difference):
    path, _, _ = trained
    with refused(DataError, f"trained for another skeleton: {difference}", path):
        use(path, description)


def test_a_missing_checkpoint_is_refused(tmp_path):
    with refused(DataError, "cannot be read .No such file", tmp_path / "none.pt"):
        use(tmp_path / "none.pt")


def not_finite(state):
    weights = dict(state["best"]["generator"])
    weights["up.3.1.bias"] = torch.full_like(weights["up.3.1.bias"], torch.nan)
    return state | {"best": state["best"] | {"generator": weights}}


@pytest.mark.parametrize("change", [
    not_finite,
    lambda state: state | {"best": state["best"] | {"generator": {}}},
    lambda state: state | {"scales": {"audio": None, "gesture": None}},
    lambda state: state | {"audio_channels": 10**9},
    lambda state: {key: value for key, value in state.items() if key != "history"},
])  # fmt: skip
@pytest.mark.slow
def test_a_forged_checkpoint_is_refused(trained, tmp_path, change):
    stored(change(trained[2]), tmp_path / "r.pt")
    with refused(DataError, "not a refiner, or damaged", tmp_path / "r.pt"):
        use(tmp_path / "r.pt")


@pytest.mark.slow
def test_any_flipped_bit_of_a_checkpoint_is_noticed(trained, tmp_path):
    whole, rng = trained[0].read_bytes(), np.random.default_rng(0)
    for number in range(20):
        place, path = int(rng.integers(len(whole))), tmp_path / f"{number}.pt"
        path.write_bytes(whole[:place] + bytes([whole[place] ^ (1 << number % 8)]) + whole[place + 1 :])
        with refused(DataError, "not a refiner, or damaged", path):
            use(path)


@pytest.mark.parametrize("damage", ["empty", "text", "cut", "flipped", "foreign", "other format"])
@pytest.mark.slow
def test_a_damaged_checkpoint_is_refused(trained, tmp_path, damage):
    path, _, state = trained
    whole = path.read_bytes()
    bad = tmp_path / "bad.pt"
    if damage == "foreign":
        stored({"weights": torch.ones(3)}, bad)
    elif damage == "other format":
        stored(state | {"format": 99}, bad)
    else:
        cut = whole[: len(whole) // 2]
        bad.write_bytes({"empty": b"", "text": b"hello", "cut": cut, "flipped": b"\0" * 64 + whole[64:]}[damage])
    with refused(DataError, "not a refiner, or damaged", bad):
        use(bad)


def test_a_checkpoint_runs_no_code(tmp_path):
    class Evil:
        def __reduce__(self):
            return (print, ("run",))

    stored({"format": 1, "evil": Evil()}, tmp_path / "evil.pt")
    with refused(DataError, "not a refiner, or damaged", tmp_path / "evil.pt"):
        use(tmp_path / "evil.pt")


@pytest.mark.slow
def test_a_run_of_something_else_is_not_taken_up(trained):
    path, _, _ = trained
    with refused(DataError, "a run with batch 4, not 8; delete it", path):
        run(path, QUICK.model_copy(update={"batch": 8}))
    with refused(DataError, "a run with another seed", path):
        run(path, seed=1)
    with refused(DataError, "a run with other pairs", path):
        run(path, pairs=make_pairs(seed=1))
    with refused(DataError, "another skeleton: joint 'right' against 'tail'", path):
        training.train(PAIRS, QUICK, 0, path, Description(("left", "tail"), 15.0))


def test_a_graphics_card_that_is_not_there_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    with refused(DataError, "device cuda"):
        run(tmp_path / "r.pt", QUICK.model_copy(update={"device": "cuda"}))


def test_pairs_that_do_not_fit_are_refused():
    with pytest.raises(ValueError, match="do not fit"):
        Pairs(PAIRS.audio, PAIRS.fake[:, :5], PAIRS.real, PAIRS.groups)
    with pytest.raises(ValueError, match="groups"):
        Pairs(PAIRS.audio, PAIRS.fake, PAIRS.real, PAIRS.groups[:3])


# --- what is learned ----------------------------------------------------------------------------------------


def test_no_window_is_given_its_own_audio():
    for count in (2, 3, 50):
        other = training._elsewhere(count, seed=0)
        assert sorted(other) == list(range(count))
        assert (other != np.arange(count)).all()


# At the text's learning rate: at 3e-4 the generator overshoots before the critic has learned anything.
LEARN = QUICK.model_copy(update={"iterations": 150, "batch": 16, "check_every": 50, "learning_rate": 1e-4})


@pytest.mark.slow
def test_the_slope_settles_and_the_audio_is_used_where_it_says_something(tmp_path):
    margins = {}
    for planted in (True, False):
        pairs = make_pairs(windows=400, groups=10, planted=planted)
        history, _ = run(tmp_path / f"{planted}.pt", LEARN, pairs)
        assert abs(np.array(history.gradient_norm[50:]) - 1).max() < 0.2
        margins[planted] = training.conditioning_margin(tmp_path / f"{planted}.pt", pairs)
        if planted:
            assert history.distance[-1] > 1.0
            assert min(history.figures) < 1.0
    heard, unheard = margins[True]["critic"], margins[False]["critic"]
    assert heard["mean"] > 5 * heard["std"]
    assert abs(unheard["mean"]) < 0.1 * heard["mean"]
    assert margins[True]["generator"]["mean"] > 0


@pytest.mark.slow
def test_the_margin_is_of_the_pairs_of_the_training(trained):
    path, _, _ = trained
    margin = training.conditioning_margin(path, PAIRS, seeds=range(2))
    assert margin["windows"] == 6
    with refused(DataError, "trained with other pairs", path):
        training.conditioning_margin(path, make_pairs(seed=1))
