"""The JSON Schema of programs says what their loader reads, all of it and nothing else."""

from __future__ import annotations

import jsonschema
import msgspec
import pytest

from engines.programs import library, schema
from engines.programs.call import SIGNATURES
from handrail import config

ACTIVITIES = {
    name: {argument: each.required for argument, each in signature.arguments.items()}
    for name, signature in SIGNATURES.items()
}
SCHEMA = schema.json_schema(ACTIVITIES)
STRUCTS = [
    each
    for each in vars(schema).values()
    if isinstance(each, type) and issubclass(each, msgspec.Struct) and not each.__name__.startswith("_")
]


def part(kind: type) -> dict:
    """What the schema says of a struct of the loader."""
    return SCHEMA["$defs"][kind.__name__]


def test_every_part_of_a_file_is_in_the_schema_and_the_reverse():
    assert {each.__name__ for each in STRUCTS} | {"State"} == SCHEMA["$defs"].keys()
    assert SCHEMA["$ref"] == "#/$defs/ProgramFile"


@pytest.mark.parametrize("kind", STRUCTS, ids=lambda kind: kind.__name__)
def test_every_field_that_is_read_is_in_the_schema_and_the_reverse(kind):
    fields = {each.encode_name: each for each in msgspec.structs.fields(kind)}
    said = part(kind)
    assert said["properties"].keys() == fields.keys()
    assert set(said.get("required", ())) == {name for name, each in fields.items() if each.required}
    assert said["additionalProperties"] is False


def test_every_list_and_mapping_says_what_is_in_it():
    free = {
        ("TransitionFile", "set"),
        ("ActionFile", "set"),
        ("ActionFile", "data"),
        ("StateFile", "data"),
        ("StateFile", "with"),
    }  # names of the program's own
    for kind in STRUCTS:
        for name, said in part(kind)["properties"].items():
            inner = said.get("items", said.get("additionalProperties"))
            if said.get("type") in ("array", "object") and (kind.__name__, name) not in free:
                assert inner, (kind, name)


def test_every_activity_with_its_arguments_is_in_it_and_the_reverse():
    said = {rule["if"]["properties"]["do"]["const"]: rule["then"] for rule in part(schema.StateFile)["allOf"]}
    assert said.keys() == ACTIVITIES.keys() == set(part(schema.StateFile)["properties"]["do"]["enum"])
    for name, arguments in ACTIVITIES.items():
        given = said[name]["properties"]["with"]
        assert given["properties"].keys() == arguments.keys()
        assert given["required"] == [each for each, must in arguments.items() if must]


def test_every_program_of_the_library_is_valid():
    jsonschema.Draft202012Validator.check_schema(SCHEMA)
    validator = jsonschema.Draft202012Validator(SCHEMA)
    for name, file in library.files().items():
        if file.suffix == ".yaml":
            assert not [problem.message for problem in validator.iter_errors(config.read(file).data)], name
