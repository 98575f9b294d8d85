"""The figures of a small tree whose numbers are counted by hand."""

from pathlib import Path

import pytest

from benchmarks.shape import as_table, circles, import_graph, measure, packages

FILES = {
    "house/__init__.py": "",
    "house/db/__init__.py": "",
    "house/db/tables.py": """
class Base: ...
class RoomRow(Base):
    __tablename__ = "room"
    id: int
    width_m: float
    height_m: float
    colour: str
class DoorRow(Base):
    __tablename__ = "door"
    id: int
class KeyRow(Base):
    __tablename__ = "key"
    id: int
""",
    "house/schemas.py": """
from house.db import tables
class Size:
    id: int
    width_m: float
    height_m: float
class Wall(Size):
    colour: str
class Floor:
    id: int
    width_m: float
    height_m: float
    colour: str
class PaintedRoom(Floor):
    coat: str
class Doors:
    n: int
""",
    "house/store/__init__.py": "from house.store import rooms",
    "house/store/rooms.py": "from house.pages import page",
    "house/pages/__init__.py": "",
    "house/pages/page.py": "import house.store.doors, house.schemas",
    "house/store/doors.py": "import house.schemas\n"
    + "\n" * 700
    + "def open():\n    def far():\n        return 1\n",
}


@pytest.fixture
def tree(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for place, text in FILES.items():
        (tmp_path / place).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / place).write_text(text)
    monkeypatch.syspath_prepend(str(tmp_path))
    return tmp_path


def test_files_importers_functions_and_circles_of_a_small_tree_are_those_counted_by_hand(tree: Path) -> None:
    shape = measure(tree, ("house",), ("house/store",))
    assert shape["files"] == {"all": 9, "house": 9}
    assert shape["files_of_packages"] == {"house/store": 3}
    assert shape["lines"]["median"] == 1
    assert shape["lines"]["above_600"] == ["house/store/doors.py"]
    assert shape["lines"]["share_below_80"] == round(8 / 9, 3)
    assert shape["function_lines"] == {"median": 2.5, "max": 3}
    # tables, rooms, page and doors by one each; schemas by page and doors.
    assert shape["modules_with_one_importer"] == 4
    # The packages import one another, but no module imports itself by way of others.
    assert shape["circles"] == {"packages": [["house.pages", "house.store"]], "modules": []}


def test_a_form_lists_four_columns_of_a_noun_itself_whatever_its_name(tree: Path) -> None:
    shape = measure(tree, ("house",), ())
    names = {noun: [c.split(":")[1] for c in each["classes"]] for noun, each in shape["forms"].items()}
    # A wall lists one of its four; a painted room has all from the floor.
    assert names == {"room": ["RoomRow", "Floor"], "door": ["DoorRow"], "key": ["KeyRow"]}


def test_the_table_names_the_packages_of_a_circle(tree: Path) -> None:
    assert "circles of packages  house.pages, house.store\n" in as_table(measure(tree, ("house",), ()))


def test_no_module_and_no_package_of_ours_imports_itself_in_a_circle() -> None:
    graph = import_graph()
    assert circles(graph) == [] and circles(packages(graph)) == []
