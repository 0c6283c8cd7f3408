"""Drive families: how each speaks on the bus. A family is a folder with the DBC file that describes its frames and a family.yaml
that says what they mean; the rest of the package makes codec, typed messages, docs and tests from them."""

from pathlib import Path

DBC_FILES = {
    file.parent.name: file for file in sorted(Path(__file__).parent.glob("*/*.dbc")) if file.stem == file.parent.name
}
"""Family → DBC file, of the families that Handrail brings."""
