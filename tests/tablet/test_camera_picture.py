"""A cloud as a picture from where its camera stands."""

from __future__ import annotations

import numpy as np
import pytest

from tablet_client.models.camera_picture import picture

CAMERA = (0.0, 0.0, 1.0)
RED, BLUE = (255, 0, 0), (0, 0, 255)
GROUND = (13, 18, 23)


def patch(
    centre: tuple[float, float, float], size: float, colour: tuple[int, int, int]
) -> tuple[np.ndarray, np.ndarray]:
    """A square of points across x, with a side of `size` m."""
    along = np.linspace(-size / 2, size / 2, 40)
    y, z = (each.ravel() for each in np.meshgrid(along, along))
    points = np.stack([np.zeros_like(y), y, z], axis=1) + centre
    return points, np.tile(np.array(colour, np.uint8), (len(points), 1))


def seen(*patches: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    positions, colours = (np.concatenate(each) for each in zip(*patches, strict=True))
    return picture(positions, colours, CAMERA, 96, 72)


def centre_of(image: np.ndarray, colour: tuple[int, int, int]) -> np.ndarray:
    rows, columns = np.nonzero((image == colour).all(axis=2))
    return np.array([columns.mean(), rows.mean()])


def test_left_is_left_and_up_is_up():
    image = seen(patch((2.0, 0.4, 1.0), 0.2, RED), patch((2.0, -0.4, 1.2), 0.2, BLUE))
    red, blue = centre_of(image, RED), centre_of(image, BLUE)
    assert red[0] < blue[0]  # +y is to the left of who looks along +x
    assert red[1] > blue[1]  # rows go down


def test_near_hides_far_in_whatever_order_they_come():
    near, far = patch((1.0, 0.0, 1.0), 0.3, RED), patch((2.0, 0.0, 1.0), 0.3, BLUE)
    for image in (seen(near, far), seen(far, near)):
        assert tuple(image[36, 48]) == RED
        assert not (image == BLUE).all(axis=2).any()


def test_what_is_twice_as_far_is_half_as_large():
    image = seen(patch((1.0, 0.5, 1.0), 0.2, RED), patch((2.0, -1.0, 1.0), 0.2, BLUE))
    sizes = [(image == colour).all(axis=2).sum() for colour in (RED, BLUE)]
    assert sizes[0] == pytest.approx(4 * sizes[1], rel=0.5)


def test_without_colours_nearer_is_paler():
    points = np.concatenate([patch((1.0, 0.3, 1.0), 0.2, RED)[0], patch((2.0, -0.6, 1.0), 0.4, RED)[0]])
    image = picture(points, None, CAMERA, 96, 72)
    assert image[:, :40].max() > image[:, 56:].max() > max(GROUND)


@pytest.mark.parametrize("points", [np.zeros((0, 3)), np.array([CAMERA]), np.array([(0.0, 0.0, 3.0)])])
def test_nothing_itself_and_straight_above_are_pictures_too(points):
    image = picture(points, None, CAMERA, 96, 72)
    assert image.shape == (72, 96, 3) and image.dtype == np.uint8


def test_a_stray_point_does_not_make_everything_small():
    wanted = patch((2.0, 0.0, 1.0), 0.4, RED)
    alone = (seen(wanted) == RED).all(axis=2).sum()
    stray = (np.array([(0.2, 3.0, 1.0)]), np.array([BLUE], np.uint8))
    assert (seen(wanted, stray) == RED).all(axis=2).sum() > alone / 2
