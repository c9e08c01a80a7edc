import pytest

torch = pytest.importorskip("torch")

from torch import nn  # noqa: E402

from gesturegen.refine.network import Critic, Generator  # noqa: E402

AUDIO, GESTURE = 28, 12


def inputs(frames, batch=2):
    draw = torch.Generator().manual_seed(frames)
    return torch.randn(batch, AUDIO, frames, generator=draw), torch.randn(batch, GESTURE, frames, generator=draw)


@pytest.fixture(scope="module")
def networks():
    torch.manual_seed(0)
    return Generator(AUDIO, GESTURE), Critic(AUDIO, GESTURE)


@pytest.mark.parametrize("frames", [1, 5, 8, 63, 64, 65, 100])
@pytest.mark.parametrize("as_printed", [False, True])
def test_any_length(networks, frames, as_printed):
    generator, critic = networks
    critic = Critic(AUDIO, GESTURE, as_printed=True) if as_printed else critic
    audio, gesture = inputs(frames)
    refined = generator(audio, gesture)
    assert refined.shape == gesture.shape
    scores = critic(audio, refined)
    assert scores.shape == (2,)
    assert torch.isfinite(scores).all()


def test_widths_are_the_papers(networks):
    generator, critic = networks
    blocks = [layer for layer in generator.modules() if isinstance(layer, nn.Conv1d)]
    assert [layer.out_channels for layer in blocks] == [
        *(128, 128, 256, 256, 256, 256, 512, 512),
        *(512, 512, 256, 256, 256, 256, 128, GESTURE),
    ]
    # One normalisation each, but for the last.
    assert sum(isinstance(layer, nn.BatchNorm1d) for layer in generator.modules()) == 15
    blocks = [layer for layer in critic.modules() if isinstance(layer, nn.Conv1d)]
    assert [layer.out_channels for layer in blocks] == [512, 512, 256, 256, 128, 128]
    for network, norm in ((critic, nn.GroupNorm), (Critic(AUDIO, GESTURE, as_printed=True), nn.InstanceNorm1d)):
        kinds = [type(layer) for layer in network.blocks]
        assert kinds == [*[nn.Conv1d, norm, nn.LeakyReLU] * 2, nn.AvgPool1d] * 3


def test_the_generator_adds_to_its_input(networks):
    generator = Generator(AUDIO, GESTURE)
    nn.init.zeros_(generator.up[-1][1].weight)
    nn.init.zeros_(generator.up[-1][1].bias)
    audio, gesture = inputs(20)
    assert torch.equal(generator(audio, gesture), gesture)


def test_fine_detail_passes_by_the_narrow_middle(networks):
    """What changes one frame changes that frame's correction, though the middle sees an eighth of the frames."""
    generator = networks[0].eval()
    audio, gesture = inputs(64)
    with torch.no_grad():
        before = generator(audio, gesture)
        louder = audio.clone()
        louder[..., 32] += 1.0
        change = (generator(louder, gesture) - before).abs().sum(dim=(0, 1))
    networks[0].train()
    assert change.argmax() in (31, 32, 33)


def test_both_see_the_audio(networks):
    generator, critic = networks
    audio, gesture = inputs(64)
    other = audio.roll(1, dims=0)
    assert not torch.equal(generator(audio, gesture), generator(other, gesture))
    assert not torch.equal(critic(audio, gesture), critic(other, gesture))


def test_the_critic_sees_posture_and_size(networks):
    """Which instance norm takes away, but for what the zeros beyond the edges leave of it."""
    _, critic = networks
    printed = Critic(AUDIO, GESTURE, as_printed=True)
    audio, gesture = inputs(64)
    for changed in (gesture + 1.0, gesture * 1.5):
        assert (critic(audio, changed) - critic(audio, gesture)).abs().min() > 1e-3
    # Without audio to compare with, the size of a gesture is nothing to instance norm.
    silence = torch.zeros_like(audio)
    for layer in printed.modules():
        if isinstance(layer, nn.Conv1d):
            nn.init.zeros_(layer.bias)
    torch.testing.assert_close(printed(silence, 1.5 * gesture), printed(silence, gesture), rtol=0, atol=1e-3)


def test_the_whole_in_one_pass_is_the_windows_in_the_middle(networks):
    """Far from the edges a frame's correction does not depend on how long the sequence is."""
    generator = networks[0].eval()
    audio, gesture = inputs(512, batch=1)
    with torch.no_grad():
        whole = generator(audio, gesture)
        part = generator(audio[..., 128:384], gesture[..., 128:384])
    networks[0].train()
    torch.testing.assert_close(part[..., 112:144], whole[..., 240:272], rtol=0, atol=1e-5)
