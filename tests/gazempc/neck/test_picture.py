"""Where a head stands in the picture when the camera points at its aim."""

import numpy as np
import pytest

import gazempc as gz
from gazempc.neck.narrow import narrowed
from gazempc.neck.picture import FramedPicture, Framing

NECK = gz.load_neck("ptz")


def picture(**values):
    return FramedPicture.of(Framing(view_deg=(60.0, 30.0), **values), NECK)


@pytest.mark.parametrize(("headroom", "above_deg"), [(0.5, 0.0), (0.4, 3.0), (0.0, 15.0)])
def test_the_head_stands_above_the_middle_by_the_headroom(headroom, above_deg):
    aim = picture(headroom=headroom).aim_rad(np.radians([[10.0, 5.0]]), 0.0)
    np.testing.assert_allclose(np.degrees(aim), [[10.0, 5.0 - above_deg]])


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_the_camera_leads_a_walker_and_not_one_who_stands(way):
    framed = picture(lead_room=0.1)
    ahead = np.degrees(framed.aim_rad(np.zeros(2), way * np.radians(60.0))[0])
    assert 5.9 < way * ahead < 6.0  # 0.1 of 60 deg
    assert framed.aim_rad(np.zeros(2), 0.0)[0] == 0.0


def test_the_zone_is_wider_against_a_turn_back_by_delay_and_deviation_up_to_the_edge():
    framed = picture(zone=(0.4, 0.4), hysteresis_per_s=0.5)  # pan: 12 deg of 30, tilt: 6 of 15
    wider = [framed.turns_back_rad(axis, 1.2, np.radians([0.0, 2.0, 20.0])) for axis in (0, 1)]
    np.testing.assert_allclose(np.degrees(wider), [[7.2, 10.2, 18.0], [3.6, 6.6, 9.0]])


def test_the_zone_is_as_wide_as_the_picture_until_a_person_who_stays_has_been_outside_for_long():
    framed = picture(zone=(0.4, 0.4))  # 12 deg of 30
    waits = [framed.waits_rad(0, 0.0, share) for share in (0.0, 0.5, 1.0)]
    np.testing.assert_allclose(np.degrees(waits), [18.0, 9.0, 0.0])
    assert np.degrees(framed.waits_rad(0, np.radians(60.0), 0.0)) < 0.1  # a walker crosses the picture
    assert framed.excursion_s(1.2) == pytest.approx(1.8)


def test_limits_are_of_the_picture_so_that_a_closer_zoom_is_as_calm():
    wide = narrowed(NECK, None, None, Framing(view_deg=(60.0, 34.0), acceleration_max=0.5))
    close = narrowed(NECK, None, None, Framing(view_deg=(6.0, 3.4), acceleration_max=0.5))
    assert wide.pan.acceleration_max_rad_s2 == pytest.approx(np.radians(30.0))
    assert close.pan.acceleration_max_rad_s2 == pytest.approx(np.radians(3.0))
    assert narrowed(NECK, None, None, Framing(subject="no")) == NECK


def test_the_angles_of_the_picture_are_the_neck_files_or_needed():
    seen = NECK.model_copy(update={"head_view_deg": (50.0, 30.0)})
    assert FramedPicture.of(Framing(), seen).view_rad[0] == np.radians(50.0)
    assert FramedPicture.of(Framing(subject="no"), NECK) is None
    with pytest.raises(gz.GazempcError, match="view_deg"):
        gz.Mpc(NECK, framing=Framing())
