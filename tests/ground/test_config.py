"""Configuration files: what is wrong is named by file, line, field and value."""

import msgspec
import pytest

from handrail import config


class Wheel(msgspec.Struct, kw_only=True, forbid_unknown_fields=True):
    radius: float
    spokes: int = 4


class Scene(msgspec.Struct, kw_only=True, forbid_unknown_fields=True):
    name: str
    wheels: list[Wheel] = []


def written(folder, text):
    file = folder / "scene.yaml"
    file.write_text(text)
    return file


def test_a_good_file_is_read_into_its_type(tmp_path):
    scene = config.read(written(tmp_path, "name: hall\nwheels:\n  - {radius: 0.15}\n")).convert(Scene)
    assert scene == Scene(name="hall", wheels=[Wheel(radius=0.15)])


@pytest.mark.parametrize(
    ("text", "line", "field"),
    [
        ("name: hall\nwheels:\n  - radius: wide\n", 3, "wheels[0].radius"),
        ("name: hall\nwheels:\n  - radius: 0.1\n    colour: red\n", 4, "wheels[0].colour"),
        ("name: 3\n", 1, "name"),
        ("wheels: []\n", None, "name"),
        ("name: hall\nwheels: [\n", 3, ""),
        ("- 1\n", 1, ""),
    ],
)
def test_a_bad_file_is_refused_with_line_and_field(tmp_path, text, line, field):
    file = written(tmp_path, text)
    with pytest.raises(config.ConfigError) as refused:
        config.read(file).convert(Scene)
    assert refused.value.line == line
    assert refused.value.field == field
    assert str(file) in str(refused.value)


def test_a_wrong_value_is_shown(tmp_path):
    with pytest.raises(config.ConfigError, match="got 'wide'"):
        config.read(written(tmp_path, "name: hall\nwheels:\n  - radius: wide\n")).convert(Scene)


@pytest.mark.parametrize("text", ["a: \x01b\n", "[" * 1000])
def test_what_is_no_yaml_at_all_is_refused(tmp_path, text):
    with pytest.raises(config.ConfigError, match=r"scene\.yaml(:1)?: not "):
        config.read(written(tmp_path, text))


def test_a_missing_file_is_said_to_be_missing(tmp_path):
    with pytest.raises(config.ConfigError, match="no such file"):
        config.read(tmp_path / "nowhere.yaml")
