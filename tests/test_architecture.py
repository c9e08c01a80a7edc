"""Each room imports only from the rooms above it (docs/architecture.md)."""

import ast
import re
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parent.parent / "gesturegen"
# From the top down; rooms in one row may not import each other, except inside a package.
ROOMS = [
    {"errors", "supervision"},
    {"inputs"},
    {"extras", "files", "outcome", "randomness", "runs", "strict_csv", "strict_yaml", "text"},
    {"locks", "stored", "compiled"},
    {"workers"},
    {"settings", "contract"},
    {"workspace", "remembered"},
    {"motion"},
    {"joints"},
    {"speech"},
    {"data"},
    {"_pose_kernels"},
    {"pose_distance"},
    {"frames", "path"},
    {"trace", "manifest"},
    {"control"},
    {"methods"},
    {"render"},
    {"refine"},
    {"metrics"},
    {"submission"},
    {"viewer"},
    {"evaluation"},
    {"doctor"},
    {"tables"},
    {"experiment"},
    {"report"},
    {"video", "inspection", "export"},
    {"demo"},
    {"warm_up"},
    {"parallel"},
    {"pipeline"},
    {"console", "api"},
    {"cli"},
    {"__main__"},
]
# What is known of a method before it is used, beside the settings: the contract, the table, and each method's own words
# and settings. What they do they import when they do it.
CONTRACT = re.compile(r"methods/(__init__|method|sections|[a-z_]+/(__init__|method|settings))\.py")
LEVEL = {room: level for level, row in enumerate(ROOMS) for room in row}
FILES = sorted(path for path in PACKAGE.rglob("*.py") if path != PACKAGE / "__init__.py")


def imports_of(path: Path, tree: ast.AST) -> list[str]:
    """Full names of what is imported; of the contract only what is imported at once."""
    names = []
    for node in tree.body if CONTRACT.fullmatch(str(path.relative_to(PACKAGE))) else ast.walk(tree):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            assert all(alias.name != "*" for alias in node.names), f"{path}: star import"
            names += [f"{node.module}.{alias.name}" for alias in node.names]
    return names


def imported_rooms(path: Path) -> set[str]:
    rooms = set()
    for name in imports_of(path, ast.parse(path.read_text())):
        parts = name.split(".")
        if parts[0] == "gesturegen" and len(parts) > 1:
            # The longest part of the name that is a module.
            files = [PACKAGE.joinpath(*parts[1:n]).with_suffix(".py") for n in range(len(parts), 1, -1)]
            file = next((file for file in files if file.is_file()), PACKAGE / parts[1] / "__init__.py")
            rooms.add(room_of(file))
    return rooms & LEVEL.keys()


def room_of(path: Path) -> str:
    place = path.relative_to(PACKAGE)
    return "contract" if CONTRACT.fullmatch(str(place)) else place.parts[0].removesuffix(".py")


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_imports_only_from_rooms_above(path):
    own = room_of(path)
    assert own in LEVEL, f"{own} is in no row of ROOMS"
    beside = {own} | ({"settings", "contract"} if own in ("settings", "contract") else set())
    below = {room for room in imported_rooms(path) - beside if LEVEL[room] >= LEVEL[own]}
    assert not below


NAMES = re.compile(r"gesture_master|motion_matching|motion_graph|viterbi|\"baseline\"")


def test_nothing_outside_names_a_method():
    """Another method is one folder. Papers may be cited, and configs that are shipped be named."""
    for path in FILES:
        if room_of(path) not in ("methods", "contract"):
            text = re.sub(r"configs/\w+\.yaml", "", path.read_text())
            assert not NAMES.search(text), path


def test_metrics_know_no_method():
    for path in PACKAGE.glob("metrics/*.py"):
        assert imported_rooms(path) <= {"metrics", "motion", "errors"}, path


def test_numba_and_librosa_come_in_by_one_door():
    """Else their caches could be torn."""
    for path in FILES:
        nodes = [
            node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Import | ast.ImportFrom)
        ]
        names = {name for node in nodes for name in [getattr(node, "module", None), *(a.name for a in node.names)]}
        packages = {(name or "").partition(".")[0] for name in names} & {"numba", "librosa", "llvmlite"}
        assert not packages or room_of(path) == "compiled", f"{path} imports {packages}"


def test_the_documents_list_every_room():
    page = (PACKAGE.parent / "docs/architecture.md").read_text()
    for room in LEVEL.keys() - {"contract"}:
        assert f"`{room}.py`" in page or f"`{room}/`" in page, room
