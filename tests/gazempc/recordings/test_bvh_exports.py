"""BVH as CMU, Mixamo, Xsens, Rokoko, MotionBuilder and Blender write it: the same person comes back."""

import numpy as np
import pytest
from builders import skeletons as sk
from scipy.spatial.transform import Rotation

from gazempc.errors import RecordingError
from gazempc.recordings.load import load
from gazempc.recordings.readers.options import ReadOptions


def check(recording):
    """The walk is along the pelvis's x axis, the head is straight above it and looks to the left."""
    truth, (times, _, _) = recording.truth, sk.walk()
    np.testing.assert_allclose(recording.times_s, times, atol=1e-4)
    above = truth.head_position_m - truth.pelvis_position_m
    np.testing.assert_allclose(above, np.tile([0.0, 0.0, sk.HEAD_ABOVE_HIPS_M], (len(times), 1)), atol=1e-4)
    np.testing.assert_allclose(truth.pelvis_position_m[:, 2], 0.94, atol=1e-4)
    speed = np.gradient(truth.pelvis_position_m, times, axis=0, edge_order=2)
    assert np.linalg.norm(speed, axis=1) == pytest.approx(1.2, rel=1e-3)
    heading = np.unwrap(np.arctan2(speed[:, 1], speed[:, 0]))
    for quats, turn in ((truth.pelvis_quat_wxyz, 0.0), (truth.head_quat_wxyz, sk.HEAD_YAW_RAD)):
        yaw, pitch, roll = Rotation.from_quat(quats, scalar_first=True).as_euler("ZYX").T
        np.testing.assert_allclose(np.unwrap(yaw - heading - turn + np.pi) % (2 * np.pi), np.pi, atol=2e-3)
        np.testing.assert_allclose([pitch, roll], 0.0, atol=1e-6)


EXPORTS = {
    "cmu_asf": (sk.CMU_ASF, {"unit_m": sk.CMU_UNIT_M}, ["unit CMU's ASF unit", "y up", "facing z at rest"]),
    "cmu_motion_builder": (sk.CMU_FOR_MOTION_BUILDER, {"unit_m": 0.0254}, ["unit inch", "head Head", "hips Hips"]),
    "mixamo": (sk.MIXAMO, {}, ["unit cm (1.", "head mixamorig:Head (tip of its bone)", "hips mixamorig:Hips"]),
    "xsens": (sk.XSENS, {}, ["hips Hips", "by left and right joints", "60 frames a second"]),
    "rokoko": (sk.ROKOKO, {}, ["head Head", "facing z at rest"]),
    "motion_builder": (sk.MOTION_BUILDER, {"above": "BVH:reference"}, ["hips Character1_Hips", "unit cm"]),
    "blender": (sk.BLENDER, {"axes": sk.Z_UP_FACING_MINUS_Y, "unit_m": 1.0}, ["facing -y at rest"]),
    "rigify": (
        sk.BLENDER_RIGIFY,
        {"axes": sk.Z_UP_FACING_MINUS_Y, "unit_m": 1.0, "head": "spine.006"},
        ["head spine.006 (tip of its bone, far end of the body's middle)", "hips spine,"],
    ),
    "no_names": (
        sk.NUMBERED,
        {"unit_m": 0.001, "head": sk.NUMBERED_HEAD},
        ["unit mm", f"head {sk.NUMBERED_HEAD} (", "facing z at rest (by the feet)"],
    ),
}


@pytest.mark.parametrize("name", EXPORTS)
def test_exports_are_read_and_one_line_states_what_was_inferred(tmp_path, name):
    tree, how, said = EXPORTS[name]
    recording = load(sk.write_bvh(tmp_path / "walk.bvh", tree, **how))
    check(recording)
    for words in [*said, "the options bvh_unit_m, bvh_up_axis, bvh_head_joint"]:
        assert words in recording.notes[0]


def side_exchanged(name):
    return name.replace("Left", "?").replace("Right", "Left").replace("?", "Right")


def test_names_and_feet_that_contradict_are_asked_about(tmp_path):
    path = sk.write_bvh(tmp_path / "walk.bvh", sk.renamed(sk.XSENS, side_exchanged))
    with pytest.raises(
        RecordingError, match=r"faces -z at rest by left and right joints, but z by the feet.*option bvh_facing"
    ):
        load(path)
    recording = load(path, ReadOptions(bvh_facing="z"))
    check(recording)
    assert "facing z at rest (by bvh_facing)" in recording.notes[0]


# Without toes and names the skeleton is the same from front and back.
NO_FEET = sk.body("0", ["1", "2"], "Head", ("a{}", "b{}"), "1 2 3", "4 5 6 7")


def test_without_feet_a_walk_shows_the_facing_and_a_standing_person_is_asked_about(tmp_path):
    recording = load(sk.write_bvh(tmp_path / "walk.bvh", NO_FEET))
    check(recording)
    assert "facing z at rest (by the direction of travel)" in recording.notes[0]
    stands = sk.write_bvh(tmp_path / "stands.bvh", NO_FEET, walks=False)
    with pytest.raises(RecordingError, match=r"no feet and no walk show the facing.*bvh_facing"):
        load(stands)
    truth = load(stands, ReadOptions(bvh_facing="-z")).truth
    yaw = Rotation.from_quat(truth.head_quat_wxyz[0], scalar_first=True).as_euler("ZYX")[0]
    assert abs(yaw) == pytest.approx(np.pi - sk.HEAD_YAW_RAD, abs=1e-6)
    with pytest.raises(RecordingError, match=r"faces y, the direction of the head.*bvh_facing"):
        load(stands, ReadOptions(bvh_facing="y"))


def test_without_a_head_the_message_names_the_option(tmp_path):
    tree = ("A", (0, 0, 0), [("B", (0, 0, 0.4), (0.0, 0.0, 0.3))])
    with pytest.raises(RecordingError, match=r"no joint that may be the head.*bvh_head_joint, one of A, B"):
        load(sk.write_bvh(tmp_path / "walk.bvh", tree, head="B"))


@pytest.mark.parametrize("named", [True, False])
def test_two_heads_are_asked_about(tmp_path, named):
    hips, offset, grown = sk.XSENS if named else sk.NUMBERED
    head = "Head" if named else sk.NUMBERED_HEAD
    second = ("Prop", (0.0, 0.0, 0.2), [("Prop_Head" if named else "Bone_91", (0.3, 0.0, 0.4), (0.0, 0.0, 0.1))])
    tree = sk.renamed((hips, offset, [*grown, second]), lambda name: f"A_{name}")
    path = sk.write_bvh(tmp_path / "walk.bvh", tree, head=f"A_{head}")
    with pytest.raises(RecordingError, match=rf"A_{head}, A_\w+ may be the head.*bvh_head_joint"):
        load(path)
    check(load(path, ReadOptions(bvh_head_joint=f"A_{head}")))


def test_two_units_are_asked_about(tmp_path):
    # Positions of joints in inches in a file with offsets in cm, as scaled retargeting leaves it.
    path = sk.write_bvh(tmp_path / "walk.bvh", sk.XSENS, positions_of=1 / 2.54)
    with pytest.raises(RecordingError, match=r"inch by the motion, cm by the rest pose.*bvh_unit_m"):
        load(path)
    assert "unit 0.0254 m by bvh_unit_m (1." in load(path, ReadOptions(bvh_unit_m=0.0254)).notes[0]
