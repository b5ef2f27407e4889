"""BVH as CMU, Mixamo, Xsens, Rokoko, MotionBuilder and Blender write it: the same person comes back, and is said."""

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
    "mixamo_z_up": (sk.MIXAMO, {"axes": sk.Z_UP_FACING_MINUS_Y, "unit_m": 1.0}, ["unit m (1.", "z up", "facing -y"]),
    "xsens": (sk.XSENS, {}, ["hips Hips", "by left and right joints", "60 frames a second"]),
    "xsens_segments": (sk.XSENS_SEGMENTS, {"axes": sk.Z_UP_FACING_X}, ["hips Pelvis", "facing x at rest"]),
    "rokoko": (sk.ROKOKO, {}, ["head Head", "facing z at rest"]),
    "motion_builder": (sk.MOTION_BUILDER, {"above": "BVH:reference"}, ["hips Character1_Hips", "unit cm"]),
    "blender": (sk.BLENDER, {"axes": sk.Z_UP_FACING_MINUS_Y, "unit_m": 1.0}, ["facing -y at rest"]),
    "rigify": (
        sk.BLENDER_RIGIFY,
        {"axes": sk.Z_UP_FACING_MINUS_Y, "unit_m": 1.0, "head": "spine.006"},
        ["head spine.006 (tip of its bone)", "hips spine,"],
    ),
}


@pytest.mark.parametrize("name", EXPORTS)
def test_exports_are_read_and_what_was_inferred_is_said_in_one_line(tmp_path, name):
    tree, how, said = EXPORTS[name]
    recording = load(sk.write_bvh(tmp_path / "walk.bvh", tree, **how))
    check(recording)
    (line,) = recording.notes
    for words in ["read as: ", *said, "the options bvh_unit_m, bvh_up_axis, bvh_head_joint"]:
        assert words in line


def test_two_heads_are_asked_about(tmp_path):
    hips, offset, grown = sk.XSENS
    second = ("Prop_Head", (0.3, 0.0, 0.5), (0.0, 0.0, 0.1))
    path = sk.write_bvh(
        tmp_path / "walk.bvh", (hips, offset, [*grown, ("Held_Head", (0.3, 0, 0), [second])]), head="Head"
    )
    check(load(path))  # the one that is named so exactly
    tree = sk.renamed((hips, offset, [*grown, second]), lambda name: f"A{'12'[name == 'Prop_Head']}_{name}")
    path = sk.write_bvh(tmp_path / "two.bvh", tree, head="A1_Head")
    with pytest.raises(RecordingError, match=r"A1_Head, A2_Prop_Head.*bvh_head_joint"):
        load(path)
    check(load(path, ReadOptions(bvh_head_joint="A1_Head")))


def test_each_option_corrects_what_was_inferred(tmp_path):
    path = sk.write_bvh(tmp_path / "walk.bvh", sk.XSENS)
    for options, words in (
        ({"bvh_unit_m": 0.011}, "unit 0.011 m"),
        ({"bvh_up_axis": "y"}, "y up"),
        ({"bvh_head_joint": "Neck", "bvh_unit_m": 0.01}, "head Neck (the joint)"),
        ({"bvh_hips_joint": "Chest2"}, "hips Chest2"),
        ({"bvh_facing": "-x"}, "facing -x at rest"),
        ({"bvh_frame_rate_hz": 30.0}, "30 frames a second"),
    ):
        assert words in load(path, ReadOptions(**options)).notes[0]
