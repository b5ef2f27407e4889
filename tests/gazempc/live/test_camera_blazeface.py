"""The network finds a face where it is; its output is read as MediaPipe defines it."""

import pytest
from skimage import data

from gazempc.live.sources.camera.blazeface import BlazeFace

# The portrait's pupils and the tip of the nose, by eye, pixels.
RIGHT_EYE, LEFT_EYE, NOSE = (203, 101), (246, 103), (226, 127)


@pytest.mark.parametrize(
    ("corner", "side"),
    [((0, 0), 512), ((-100, -150), 700), ((150, 30), 150)],
    ids=["whole", "beyond the edges", "the face alone"],
)
def test_a_face_is_found_in_pixels_of_the_picture(corner, side):
    found = BlazeFace().faces(data.astronaut(), corner, side, 0.5)
    assert len(found) == 1
    assert found[0].points_px[0] == pytest.approx(RIGHT_EYE, abs=0.025 * side)
    assert found[0].points_px[1] == pytest.approx(LEFT_EYE, abs=0.025 * side)
    assert found[0].points_px[2] == pytest.approx(NOSE, abs=0.035 * side)


def test_no_face_is_found_where_none_is():
    assert BlazeFace().faces(data.astronaut(), (0, 250), 256, 0.5) == []
