"""The house keeps its rules: light import, floors, no reference to what users do not have."""

import ast
import pathlib
import re
import subprocess
import sys

import pytest

import cosserat_fem as cf

ROOT = pathlib.Path(__file__).parents[1]
PACKAGE = ROOT / "cosserat_fem"
FILES = sorted(PACKAGE.rglob("*.py"))


def test_import_is_light():
    """`import cosserat_fem` loads nothing heavy, and building a model none of the readers and writers."""
    heavy = ("pyvista", "meshio", "pyamg", "pydantic", "matplotlib", "h5py", "distributed")
    code = f"""
import sys, cosserat_fem as cf
print([m for m in ('numpy', 'numba', *{heavy}) if m in sys.modules])
rod = cf.Rod("r", cf.Section.round(0.01, youngs_modulus=1e9), [(0, 0, 0), (1, 0, 0)])
cf.Model([rod], [cf.Clamp(rod, "start")])
print([m for m in {heavy} if m in sys.modules])
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["[]", "[]"]


def test_public_names_exist():
    for name in cf.__all__:
        assert getattr(cf, name).__doc__ or name == "GROUND"
    with pytest.raises(AttributeError, match="no attribute 'Rodd'"):
        _ = cf.Rodd


@pytest.mark.parametrize("file", FILES, ids=lambda f: str(f.relative_to(PACKAGE)))
def test_room(file):
    """Every room states its rule; no assert, no print, no unfinished note; libraries stay in their rooms."""
    text = file.read_text()
    tree = ast.parse(text)
    docstring = ast.get_docstring(tree)
    assert docstring, "no docstring"
    if file.name not in ("__main__.py",):
        assert "Rule:" in docstring or "kernels" in str(file) or file.name in ("forms.py",)
    for node in ast.walk(tree):
        assert not isinstance(node, ast.Assert)
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            assert node.func.id != "print"
    assert not re.search(r"\b(TODO|FIXME|XXX|HACK)\b", text)
    top = {
        alias.name.split(".")[0]
        for node in tree.body
        if isinstance(node, ast.Import | ast.ImportFrom)
        for alias in (node.names if isinstance(node, ast.Import) else [ast.alias(node.module or "")])
    }
    room = str(file.relative_to(PACKAGE))
    if "numba" in top:
        assert room == "kernels/__init__.py"
    if "skfem" in top:
        assert room in ("space.py", "forms.py")
    if "pydantic" in top:
        assert room.startswith("scene/")
    if "pyvista" in top:
        assert room == "view.py"
    if "matplotlib" in top:
        assert room in ("plots.py", "bench/plots.py", "sweep/plots.py", "design/plots.py")
    assert not top & {"meshio", "h5py", "pyamg"}


def test_no_path_leaves_the_project():
    """Relative paths in files that users get end inside the project, where there is such a file or folder."""
    files = [*ROOT.glob("*.md"), *ROOT.glob("docs/*.md"), *ROOT.glob("examples/*"), *ROOT.glob("meshes/*.md"), *FILES]
    for file in [*files, *ROOT.glob("tests/**/*.py")]:
        for path in re.findall(r"(?:\.\./)+[\w./-]*\w", file.read_text(encoding="utf-8")) if file.is_file() else ():
            target = (file.parent / path).resolve()
            assert target.is_relative_to(ROOT.resolve()), f"{file}: {path}"


def test_every_mesh_is_small_and_described():
    readme = (ROOT / "meshes" / "README.md").read_text()
    for file in (ROOT / "meshes").iterdir():
        assert file.stat().st_size < 200_000
        assert file.name in readme or file.name == "README.md"
