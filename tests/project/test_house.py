"""The drawing of the house shows the code as it is."""

import xml.etree.ElementTree as ElementTree
from dataclasses import replace

import pytest

from draw_house import (
    PICTURE,
    Room,
    arrows_now,
    picture,
    placed,
    rooms,
    storeys,
    stretches,
    untangled,
    up_to_date,
)
from house import STAGES, graph_of, module_files, stage_imports, without_detours
from measure_house import crowded, deepest_chain, options, rooms_entered


@pytest.fixture(scope="module")
def house():
    """The rooms that the code has now."""
    return rooms()


@pytest.fixture(scope="module")
def arrows():
    """Who imports whom now."""
    return arrows_now()


def test_the_committed_drawing_is_up_to_date(house, arrows):
    assert up_to_date(PICTURE.read_text("utf-8"), house, arrows), "run scripts/draw_house.py"


@pytest.mark.parametrize("factor, fresh", [(1.0, True), (1.05, True), (1.25, False)])
def test_lines_may_be_a_tenth_off(factor, fresh, house, arrows):
    grown = [replace(room, lines=round(factor * room.lines)) if room.name == "field" else room
             for room in house]
    assert up_to_date(picture(house, arrows), grown, arrows) is fresh


def test_a_new_room_or_arrow_is_noticed(house, arrows):
    before = picture(house, arrows)
    assert not up_to_date(before, house, {**arrows, "share": {*arrows["share"], "face"}})
    more = [replace(room, inner=(*room.inner, Room("cellar", 1, 10)))
            if room.name == "field" else room for room in house]
    assert not up_to_date(before, more, arrows)


def test_arrows_that_others_imply_are_left_out():
    graph = {"a": {"b", "c", "d"}, "b": {"c"}, "c": {"d"}, "d": set()}
    assert without_detours(graph) == {"a": {"b"}, "b": {"c"}, "c": {"d"}, "d": set()}


def test_imports_between_stages_join_those_of_their_modules():
    graph = {"pack.job.one": {"pack.field", "pack.files"}, "pack.job.two": {"pack.face.mask"},
             "pack.field": {"pack.field.grid"}}
    found = stage_imports(graph)
    assert found["job"] == {"field", "face"} and not found["field"] and set(found) == set(STAGES)


def test_arrows_run_down_and_boxes_do_not_overlap(house, arrows):
    levels = storeys(arrows)
    boxes, width, bottom = placed(house, untangled(levels, stretches(arrows, levels)))
    for name, others in arrows.items():
        for other in others:
            assert boxes[name].y + boxes[name].height < boxes[other].y
    shown = [box for name, box in boxes.items() if name in STAGES]
    assert len(shown) == len(STAGES)
    for i, one in enumerate(shown):
        assert one.x >= 0 and one.x + one.width <= width and one.y + one.height <= bottom
        for two in shown[i + 1:]:
            assert (one.x + one.width < two.x or two.x + two.width < one.x
                    or one.y + one.height < two.y or two.y + two.height < one.y)


def test_the_drawing_is_sound_xml():
    root = ElementTree.fromstring(PICTURE.read_text("utf-8"))
    shown = {entry.get("data-room") for entry in root.iter() if entry.get("data-room")}
    assert set(STAGES) <= shown and "ground floor/simd" in shown and "field/kernels" in shown


def test_the_deepest_chain_of_imports_is_followed():
    graph = {"a": {"b", "c"}, "b": {"d"}, "c": set(), "d": {"c"}, "e": {"e"}}
    assert deepest_chain(graph) == ["a", "b", "d", "c"]


def test_names_of_a_package_lead_to_their_modules_where_it_loads_them_when_asked(tmp_path):
    (tmp_path / "door").mkdir()
    for name, text in (("user.py", "from .door import thing"), ("door/__init__.py", ""),
                       ("door/__init__.pyi", "from .one import thing\nfrom .two import other"),
                       ("door/one.py", ""), ("door/two.py", "from ..far import away"),
                       ("far.py", "")):
        (tmp_path / name).write_text(text)
    files = module_files(tmp_path, "pack")
    assert graph_of(files)["pack.user"] == {"pack.door"}
    assert deepest_chain(graph_of(files))[-1] == "pack.far"
    loaded = graph_of(files, asked=True)
    assert loaded["pack.user"] == {"pack.door.one"} and loaded["pack.door"] == set()


def test_functions_take_eight_parameters_at_most():
    """But for those that a job, a live panel and a stylisation are asked for by."""
    assert crowded() == ["job/pipeline.py make", "lightfield/screens/live.py show_field",
                         "stylize/stylization.py stylize_with_figures"]


def test_parameters_are_counted_without_self_and_kernels(tmp_path):
    (tmp_path / "kernels").mkdir()
    (tmp_path / "kernels" / "one.py").write_text("def loop(a, b, c): ...")
    (tmp_path / "two.py").write_text(
        "class A:\n    def few(self, a, b): ...\n    def many(self, a, *, b, c): ...\n"
        "@lean_kernel(x)\ndef cast(a, b, c): ...\ndef loose(a, /, b, c): ...")
    assert sorted(crowded(2, tmp_path)) == ["two.py loose", "two.py many"]


def test_options_are_no_more_than_people_can_read():
    assert 250 < options() <= 330


def test_rooms_are_noted_as_calls_enter_them():
    from lfportrait import Display

    rooms, changes = rooms_entered(lambda: Display.preset("generic-1080p"))
    assert rooms[0] == "lfportrait/lightfield" and changes >= len(rooms)
