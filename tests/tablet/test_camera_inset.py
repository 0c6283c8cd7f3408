"""The camera's inset in the window."""

from __future__ import annotations

import msgspec
import pytest

pytestmark = pytest.mark.window


def test_the_inset_shows_what_the_camera_sees_only_while_it_is_wanted(robot, show):
    shown = show().drawn()
    robot.publish(robot.picture())
    shown.until(lambda: shown.item("inset").isEnabled())
    assert not shown.item("cameraInset").isVisible()
    assert shown.desk.camera.image.isNull()
    shown.press("inset")
    shown.until(lambda: shown.item("cameraInset").isVisible())
    shown.until(lambda: not shown.desk.camera.image.isNull())
    image = shown.desk.camera.image
    reds = sum(image.pixelColor(x, y).red() > 200 for x in range(image.width()) for y in range(image.height()))
    assert reds > 100  # its 400 points are red
    before = image.cacheKey()
    robot.publish(msgspec.structs.replace(robot.picture((0.6, 0.2, 0.4)), time_ns=robot.time_ns + 1))
    shown.until(lambda: shown.desk.camera.image.cacheKey() != before)
    shown.press("inset")
    shown.until(lambda: not shown.item("cameraInset").isVisible())
