"""Strings are ready for translation: with every one of them marked, all that any page shows or speaks is marked, but for data."""

from __future__ import annotations

import re
import subprocess
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest
import yaml

import tablet_client

pytestmark = pytest.mark.window

QML = Path(tablet_client.__file__).parent / "qml"
MARK = "⟦"
_UNITS = "mm|m|mm/s|m/s|°|rad|rad/s|s|ms|N|N·m|Nm|%|MB|KB/s|Hz|kg"
FIGURE = re.compile(rf"[-+−]?[\d.,–]* ?({_UNITS})( / .*)?|[-+−]?↻?[xyz]")
"""a number with its unit, a unit, an axis: the same in any language"""


@pytest.fixture
def marked(qt: None, tmp_path: Path) -> Iterator[None]:
    """A translation that puts each text between brackets, made by Qt's own tools, as any translation is."""
    import PySide6
    from PySide6.QtCore import QCoreApplication, QTranslator

    tools, file = Path(PySide6.__file__).parent, tmp_path / "marked.ts"
    texts = ["-target-language", "en_US", *map(str, sorted(QML.glob("*.qml")))]
    subprocess.run([tools / "lupdate", *texts, "-ts", file], check=True, capture_output=True)
    tree = ET.parse(file)
    for message in tree.iter("message"):
        translation, source = message.find("translation"), message.findtext("source")
        assert translation is not None
        translation.attrib.pop("type", None)
        for form in translation.findall("numerusform") or [translation]:
            form.text = f"{MARK}{source}⟧"
    tree.write(file, encoding="utf-8")
    subprocess.run([tools / "lrelease", file], check=True, capture_output=True)
    translator = QTranslator()
    assert translator.load(str(file.with_suffix(".qm")))
    QCoreApplication.installTranslator(translator)
    yield
    QCoreApplication.removeTranslator(translator)


def strings(value: Any) -> Iterator[str]:
    """All that stand in data, keys among them."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict):
        for key, each in value.items():
            yield from (*strings(key), *strings(each))
    elif isinstance(value, list | tuple | set):
        for each in value:
            yield from strings(each)


def spoken(item: Any) -> Iterator[tuple[str, str]]:
    """What an item shows, and what a screen reader says of it: the property, and the text."""
    from PySide6.QtQml import QQmlProperty, qmlContext

    for name in ("text", "placeholderText"):
        if isinstance(text := item.property(name), str):
            yield name, text
    context = qmlContext(item)
    for name in ("Accessible.name", "Accessible.description"):
        if context is not None and isinstance(text := QQmlProperty(item, name, context).read(), str):
            yield name, text


def test_all_that_any_page_shows_goes_through_the_translator_but_for_data(marked, robot, show):
    answer, told = robot.answer, list[Any]()

    def answered(call: Any) -> Any:
        told.append(found := answer(call))
        return found

    robot.answer = answered
    robot.instances, robot.plans = [robot.wheel()], [robot.plan()]
    robot.run, robot.prompts = robot.running(), [robot.prompt()]
    told += [*robot.instances, *robot.plans, robot.run, *robot.prompts, robot.outline(), robot.state()]
    shown = show().drawn()
    shown.until(lambda: shown.item("promptCard").isVisible())
    robot.publish(robot.state())
    shown.desk.bench.select("wheel_1")
    found: dict[str, tuple[str, str, str]] = {}
    for page in shown.pages():
        shown.page(page)
        if page == "move":
            shown.desk.move.showTarget("mass")
        shown.turn(0.2)
        for item in shown.all_items():
            for name, text in spoken(item):
                if MARK not in text and re.search(r"[^\W\d_]", text) and not FIGURE.fullmatch(text):
                    found[text] = (page, item.objectName(), name)
    template = yaml.safe_load((QML.parents[1] / "affordance_templates/library/wheel.yaml").read_text())
    known = {"tcp://somewhere:47800", "Ada", "engine", *strings(template)}
    known |= {text for each in told for text in strings(msgspec.to_builtins(each, enc_hook=str))}
    known |= set(robot.description.joints) | set(robot.description.arms)
    known |= {text.removesuffix("_joint").replace("_", " ") for text in known}
    known = {text.casefold() for text in known}
    assert {text: where for text, where in found.items() if text.casefold() not in known} == {}
    assert len(found) > 40, "the data was there"
