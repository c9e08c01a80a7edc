"""What an ablation runs: one base config, setups that change a few of its settings, and seeds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from gesturegen import inputs, strict_yaml
from gesturegen.errors import ConfigError
from gesturegen.settings.loading import configs_folder, layer_config, load_ablation, load_config
from gesturegen.settings.models import Config

# What a setup may not change: the stored clips, who is whose reference, and what measures them. Only then
# does a difference between two rows come from the setup. How much of its references it uses is its own.
SHARED = (
    "seed", "paths", "data", "audio", "fps", "motion", "skeleton", "joints", "wrists", "blacklist", "exclude", "breaks", "prosody", "acoustics", "evaluation",
    "references.mode", "references.k", "references.list", "positions.root_joint", "onsets.sample_rate", "onsets.hop_length", "onsets.muted_min_seconds",
    "onsets.muted_max_seconds", "onsets.muted_margin_seconds",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Plan:
    """base : what all setups share; setups : their settings by name, in the order of the table."""

    base: Config
    seeds: tuple[int, ...]
    setups: dict[str, Config]

    @property
    def signature(self) -> dict:
        """What names the plan: the hash of each setup's settings at the first seed, and the seeds."""
        first = self.seeds[0]
        hashes = {name: seeded(config, first).signature() for name, config in self.setups.items()}
        return {"config_hashes": hashes, "seeds": list(self.seeds)}


def seeded(config: Config, seed: int) -> Config:
    """`config` with another run seed."""
    return config.model_copy(update={"seed": seed})


def load_plan(
    path: str | Path | None = None, overrides: Sequence[str] = (), folders: Mapping[str, str] | None = None
) -> Plan:
    """The plan of an ablation file, `configs/ablation.yaml` without one.

    overrides, folders : of the base config, as in `load_config`

    Raises ConfigError with one line per mistake.
    """
    path = Path(path) if path is not None else configs_folder() / "ablation.yaml"
    listed, lines = load_ablation(path)
    for override in overrides:
        if override.partition("=")[0].strip() == "seed":
            raise ConfigError(
                f"--set {inputs.shown(override)}: an ablation has its own seeds; change `seeds` in {inputs.shown(path)}"
            )
    base_path = None
    if listed.base is not None:
        base_path = _beside(path, listed.base, f"{inputs.shown(path)}:{lines[('base',)]}: base")
    base = load_config(base_path, overrides, folders)
    setups: dict[str, Config] = {}
    for number, name in enumerate(listed.setups):
        where = f"{inputs.shown(path)}:{lines[('setups', number)]}: setups"
        file = _beside(path, name, where)
        if file.stem in setups:
            raise ConfigError(f"{where}: two setups are called {file.stem}; rename one of the files")
        setups[file.stem] = _setup(base, file)
    return Plan(base, listed.seeds, setups)


def _beside(path: Path, name: str, where: str) -> Path:
    file = path.parent / name
    if not inputs.is_file(file):
        raise ConfigError(f"{where}: {file} does not exist; paths are relative to the folder of {path.name}")
    return file


def _setup(base: Config, file: Path) -> Config:
    _, lines = strict_yaml.read_mapping(file, "check the path")
    for key, line in lines.items():
        name = ".".join(map(str, key))
        if name in SHARED:
            raise ConfigError(f"{file}:{line}: {name}: all setups must share it; set it in the base config instead")
    return layer_config(base, file)
