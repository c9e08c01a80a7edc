"""The wheel holds all that an installed gesturegen needs."""

import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

TOP = Path(__file__).parent.parent


@pytest.mark.slow
def test_the_wheel_carries_the_configs_and_works_from_anywhere(tmp_path):
    build = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", str(tmp_path), str(TOP)]
    subprocess.run(build, check=True)
    (wheel,) = tmp_path.glob("*.whl")
    site = tmp_path / "site"
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
        archive.extractall(site)
    for config in (TOP / "configs").glob("*.yaml"):
        assert f"gesturegen/configs/{config.name}" in names
    assert not [name for name in names if name.startswith(("tests/", "scripts/"))]
    code = f"import sys; sys.path.insert(0, {str(site)!r}); import gesturegen.settings.loading as c; print(c.__file__, c.load_config().signature())"
    shown = subprocess.run(
        [sys.executable, "-I", "-c", code], capture_output=True, text=True, check=True, cwd=tmp_path
    ).stdout
    assert str(site) in shown
    from gesturegen.settings.loading import load_config

    assert shown.split()[-1] == load_config().signature()
