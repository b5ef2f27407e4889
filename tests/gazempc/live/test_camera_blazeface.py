"""The network finds a face where it is; its output is read as MediaPipe says."""

import numpy as np
import pytest
from skimage import data

from gazempc.live.sources.camera.blazeface import BlazeFace, anchors, decoded, shared

# The portrait's pupils and the tip of the nose, by eye, pixels.
RIGHT_EYE, LEFT_EYE, NOSE = (203, 101), (246, 103), (226, 127)


def test_anchors_are_the_middles_of_cells_row_by_row():
    found = anchors()
    assert found.shape == (48 * 48, 2)
    assert found[0] == pytest.approx([2 / 192, 2 / 192])
    assert found[1] == pytest.approx([6 / 192, 2 / 192])
    assert found[48] == pytest.approx([2 / 192, 6 / 192])


def test_numbers_are_read_as_offsets_from_the_anchor_but_the_size_is_none():
    raw = np.arange(16.0)[None]
    found = decoded(raw, np.array([[0.5, 0.25]]))[0] * 192
    assert found[0] == pytest.approx([96, 48 + 1])
    assert found[1] == pytest.approx([2, 3])
    assert found[7] == pytest.approx([96 + 14, 48 + 15])


@pytest.mark.parametrize(
    ("corner", "side"),
    [((0, 0), 512), ((80, 0), 260), ((-100, -150), 700), ((150, 30), 150)],
    ids=["whole", "part", "beyond the edges", "the face alone"],
)
def test_a_face_is_found_in_pixels_of_the_picture(corner, side):
    found = BlazeFace().faces(data.astronaut(), corner, side, 0.5)
    assert len(found) == 1
    assert found[0].points_px[0] == pytest.approx(RIGHT_EYE, abs=0.025 * side)
    assert found[0].points_px[1] == pytest.approx(LEFT_EYE, abs=0.025 * side)
    assert found[0].points_px[2] == pytest.approx(NOSE, abs=0.035 * side)


def test_nobody_is_found_where_nobody_is():
    assert BlazeFace().faces(data.astronaut(), (0, 250), 256, 0.5) == []


def test_shared_area_of_boxes():
    others = np.array([[1.0, 0.0], [0.0, 0.0], [5.0, 0.0]])
    sizes = np.array([[2.0, 2.0], [2.0, 2.0], [2.0, 2.0]])
    assert shared(np.zeros(2), np.array([2.0, 2.0]), others, sizes) == pytest.approx([2 / 6, 1, 0])
