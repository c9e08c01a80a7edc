"""Each room imports only from the rooms above it (docs/architecture.md)."""

import ast
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parent.parent / "gesturegen"
# From the top down; rooms in one row may not import each other, except inside a package.
ROOMS = [
    {"errors", "supervision"},
    {"inputs"},
    {"extras", "files", "randomness", "runs", "strict_csv", "strict_yaml"},
    {"workspace", "stored", "compiled"},
    {"workers"},
    {"config"},
    {"remembered"},
    {"motion"},
    {"joints"},
    {"speech"},
    {"recordings"},
    {"clips"},
    {"keynodes"},
    {"graph"},
    {"gestures", "control"},
    {"search"},
    {"matching"},
    {"methods"},
    {"render"},
    {"refine"},
    {"metrics"},
    {"submission"},
    {"viewer"},
    {"evaluation"},
    {"doctor"},
    {"tables"},
    {"ablation"},
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
LEVEL = {room: level for level, row in enumerate(ROOMS) for room in row}
FILES = sorted(path for path in PACKAGE.rglob("*.py") if path != PACKAGE / "__init__.py")


def imported_rooms(path: Path) -> set[str]:
    rooms = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            assert all(alias.name != "*" for alias in node.names), f"{path}: star import"
            names = [f"{node.module}.{alias.name}" for alias in node.names]
        else:
            continue
        rooms |= {name.split(".")[1] for name in names if name.startswith("gesturegen.")}
    return rooms & LEVEL.keys()


def room_of(path: Path) -> str:
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_imports_only_from_rooms_above(path):
    own = room_of(path)
    assert own in LEVEL, f"{own} is in no row of ROOMS"
    below = {room for room in imported_rooms(path) if room != own and LEVEL[room] >= LEVEL[own]}
    assert not below


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
    for room in LEVEL:
        assert f"`{room}.py`" in page or f"`{room}/`" in page, room
