"""The plan of an experiment: one base config, setups that change a few of its settings, and seeds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from gesturegen import inputs, strict_yaml
from gesturegen.errors import ConfigError
from gesturegen.experiment.grid import Changes, combinations, written_in_place
from gesturegen.settings.loading import configs_folder, layer_config, load_config, load_plan_file
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
    """The plan of an experiment.

    base : what all setups share; setups : their settings by name, in the order of the table
    """

    base: Config
    seeds: tuple[int, ...]
    setups: dict[str, Config]

    @property
    def signature(self) -> dict:
        """Name the plan: the hash of each setup's settings at the first seed, and the seeds."""
        first = self.seeds[0]
        hashes = {name: seeded(config, first).signature() for name, config in self.setups.items()}
        return {"config_hashes": hashes, "seeds": list(self.seeds)}


def seeded(config: Config, seed: int) -> Config:
    """Give `config` another run seed."""
    return config.model_copy(update={"seed": seed})


def load_plan(
    path: str | Path | None = None, overrides: Sequence[str] = (), folders: Mapping[str, str] | None = None
) -> Plan:
    """Read a plan of setups and seeds, `configs/ablation.yaml` without one.

    overrides, folders : of the base config, as in `load_config`

    Raises ConfigError with one line per mistake.
    """
    path = Path(path) if path is not None else configs_folder() / "ablation.yaml"
    listed, lines = load_plan_file(path)
    origin = inputs.shown(path)
    for override in overrides:
        if override.partition("=")[0].strip() == "seed":
            raise ConfigError(f"--set {inputs.shown(override)}: a plan has its own seeds; change `seeds` in {origin}")
    base_path = None
    if listed.base is not None:
        base_path = _beside(path, listed.base, f"{origin}:{lines['base',]}: base")
    base = load_config(base_path, overrides, folders)
    setups: dict[str, Config] = {}

    def add(name: str, changes: Changes, file: Path, where: str) -> None:
        if name in setups:
            raise ConfigError(f"{where}: two setups are called {name}; rename one of them")
        setups[name] = _setup(base, changes, file)

    for number, entry in enumerate(listed.setups or ()):
        key = ("setups", number)
        where = f"{origin}:{lines[key]}: setups"
        if isinstance(entry, str):
            file = _beside(path, entry, where)
            add(file.stem, Changes(*strict_yaml.read_mapping(file, "check the path")), file, where)
        else:
            add(*written_in_place(entry, key, lines, origin), path, where)
    if listed.grid is not None:
        for name, changes, where in combinations(listed.grid, lines, origin):
            add(name, changes, path, where)
    if not setups:
        raise ConfigError(f"{origin}:{lines['grid',]}: grid: every combination is left out; keep one")
    return Plan(base, listed.seeds, setups)


def _beside(path: Path, name: str, where: str) -> Path:
    file = path.parent / name
    if not inputs.is_file(file):
        raise ConfigError(f"{where}: {file} does not exist; paths are relative to the folder of {path.name}")
    return file


def _setup(base: Config, changes: Changes, file: Path) -> Config:
    for key, line in changes.lines.items():
        name = ".".join(map(str, key))
        if name in SHARED:
            raise ConfigError(f"{file}:{line}: {name}: all setups must share it; set it in the base config instead")
    return layer_config(base, changes.values, changes.lines, file)
