"""Faces in a picture, and names of people from picture to picture."""

import numpy as np
import pytest
from skimage import data

from gazempc.live.sources.camera.blazeface import BlazeFace, Face
from gazempc.live.sources.camera.finder import FaceFinder

FRAME_S = 1 / 15
PICTURE = np.zeros((480, 640, 3), np.uint8)
# Key points of a face of width 1 around the middle of its box: eyes, nose, mouth, ears.
POINTS = np.array([[-0.19, -0.2], [0.19, -0.2], [0, 0.02], [0, 0.22], [-0.42, -0.07], [0.42, -0.07]])


class Faces:
    """Finds what a test puts into `here`: middle and width in pixels. It sees faces of a sixteenth of the square on."""

    def __init__(self):
        self.here = []
        self.score = self.mirrored_score = 0.8

    def faces(self, picture, corner_px, side_px, score_min, mirrored=False):
        found = []
        for x, y, width in self.here:
            inside = all(
                low + width / 4 <= at <= low + side_px - width / 4 for at, low in zip((x, y), corner_px, strict=True)
            )
            score = self.mirrored_score if mirrored else self.score
            if inside and side_px / 16 <= width <= side_px / 1.5 and score_min <= score:
                found.append(Face(np.array([x, y, width, width]), np.array([x, y]) + width * POINTS, score))
        return found


@pytest.fixture
def faces():
    return Faces()


@pytest.fixture
def finder(faces):
    return FaceFinder(faces)


def names(found):
    return [person.person_id for person in found]


def after(finder, pictures, start_s=0.0):
    """Names in the last one of some pictures."""
    return names([finder.see(PICTURE, start_s + k * FRAME_S) for k in range(pictures)][-1])


@pytest.mark.parametrize("face", [(100, 100, 24), (320, 260, 300), (610, 450, 30)])
def test_a_new_face_is_handed_on_within_half_a_second(faces, finder, face):
    faces.here = [face]
    assert after(finder, 8) == ["1"]


@pytest.mark.parametrize(("rate_hz", "pictures"), [(15, 3), (5, 2), (60, 12)])
def test_a_face_of_a_few_pictures_is_not_handed_on(faces, finder, rate_hz, pictures):
    """Hair and bald heads from behind score like faces for up to 0.2 s."""
    for k in range(40):
        faces.here = [(320, 240, 90)] if k % 20 < pictures else []
        assert finder.see(PICTURE, k / rate_hz) == []


def test_what_is_no_face_in_the_mirror_is_no_face(faces, finder):
    faces.here, faces.mirrored_score = [(320, 240, 90)], 0.35
    assert all(finder.see(PICTURE, k * FRAME_S) == [] for k in range(30))
    faces.mirrored_score = 0.8
    assert after(finder, 8, 2.0) == ["1"]
    # A person who is followed turns away: the score stays, the mirror image is not a face any more.
    faces.score, faces.mirrored_score = 0.45, 0.32
    assert names(finder.see(PICTURE, 3.0)) == ["1"]
    faces.mirrored_score = 0.28
    assert finder.see(PICTURE, 3.1) == []


def test_a_person_keeps_the_name_while_walking_and_while_the_camera_turns(faces, finder):
    for k in range(60):
        faces.here = [(60 + 4 * k + (60 if k > 30 else 0), 200, 30)]
        found = finder.see(PICTURE, k * FRAME_S)
        if k > 5:
            assert names(found) == ["1"]
            assert found[0].face.box_px[:2] == pytest.approx(faces.here[0][:2])
    for k in range(6):  # also on a slow computer
        faces.here = [(380 + 4 * k, 200, 30)]
        assert names(finder.see(PICTURE, 4.0 + 1.5 * k)) == ["1"]


def test_two_people_who_pass_each_other_keep_their_names(faces, finder):
    for k in range(60):
        faces.here = [(100 + 6 * k, 200, 40), (500 - 6 * k, 260, 60)]
        found = finder.see(PICTURE, k * FRAME_S)
    left, right = sorted(found, key=lambda person: person.face.box_px[0])
    assert {left.person_id, right.person_id} == {"1", "2"}
    assert left.width_px == pytest.approx(60)


def test_who_comes_back_soon_has_the_name_still_and_later_another(faces, finder):
    for here, pictures, start_s, found in (
        ([(300, 200, 40)], 8, 0.0, ["1"]),
        ([], 8, 0.6, []),
        ([(330, 200, 40)], 3, 1.2, ["1"]),
        ([], 30, 2.0, []),
        ([(330, 200, 40)], 8, 5.0, ["2"]),
    ):
        faces.here = here
        assert after(finder, pictures, start_s) == found


# The portrait's pupils and the tip of the nose, by eye, pixels.
RIGHT_EYE, LEFT_EYE, NOSE = (203, 101), (246, 103), (226, 127)


@pytest.mark.parametrize(("corner", "side"), [((0, 0), 512), ((-100, -150), 700), ((150, 30), 150)])
def test_a_face_is_found_in_pixels_of_the_picture_also_beyond_its_edges_and_none_where_none_is(corner, side):
    detector = BlazeFace()
    (found,) = detector.faces(data.astronaut(), corner, side, 0.5)
    assert found.points_px[0] == pytest.approx(RIGHT_EYE, abs=0.025 * side)
    assert found.points_px[1] == pytest.approx(LEFT_EYE, abs=0.025 * side)
    assert found.points_px[2] == pytest.approx(NOSE, abs=0.035 * side)
    assert detector.faces(data.astronaut(), (0, 250), 256, 0.5) == []
