"""A user's own robots, scenes, programs and templates come before the built-in ones, and nothing needs a fork."""

import shutil

import pytest

from affordance_templates import catalogue
from engines.programs import library
from hal.plant import scene
from handrail.robot import library as robots


@pytest.fixture
def own(tmp_path, monkeypatch):
    monkeypatch.setenv("HANDRAIL_WORKSPACE", str(tmp_path))
    return tmp_path


def copied(file, folder, name):
    folder.mkdir()
    return shutil.copy(file, folder / name)


def test_a_scene_of_the_workspace_is_found_by_its_name(own):
    copied(scene.library()["valve"], own / "scenes", "hall.yaml")
    assert scene.find("hall") == own / "scenes" / "hall.yaml"
    assert {"hall", "valve"} <= set(scene.library())


def test_a_template_of_the_workspace_hides_the_built_in_one_of_the_same_name(own):
    copied(catalogue.files()["wheel"], own / "affordance_templates", "wheel.yaml")
    assert catalogue.files()["wheel"].is_relative_to(own)


def test_a_program_of_the_workspace_is_listed_beside_the_built_in_ones(own):
    copied(library.files()["turn_valve"], own / "rtc_programs", "turn_twice.yaml")
    assert {"turn_twice", "turn_valve"} <= {entry.name for entry in library.listing().entries}


def test_a_robot_of_the_workspace_is_found_by_its_name(own):
    shutil.copytree(robots.find("talos_upper").parent, own / "robots" / "my_talos")
    assert robots.load("my_talos").folder == own / "robots" / "my_talos"
