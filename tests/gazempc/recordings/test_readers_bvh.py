"""BVH: hand-computed skeletons and exports of many programs; errors with file, line and remedy."""

import numpy as np
import pytest
from builders import skeletons as sk
from builders.recordings import assert_refused
from scipy.spatial.transform import Rotation

from gazempc.errors import RecordingError
from gazempc.recordings.load import load
from gazempc.recordings.readers.options import ReadOptions

N = 30


def joint(kind, name, offset, *inside, channels="3 Zrotation Xrotation Yrotation"):
    body = (f"OFFSET {offset}", f"CHANNELS {channels}", *inside)
    return [f"{kind} {name}", "{", *(f"  {line}" for line in body), "}"]


def end(offset):
    return ["End Site", "{", f"  OFFSET {offset}", "}"]


# Y up, facing +z, person's left +x, centimetres; the order in the file is that of many exporters.
HIPS = joint(
    "ROOT",
    "Hips",
    "0.0 0.0 0.0",
    *joint("JOINT", "LeftUpLeg", "9.0 -5.0 0.0", *end("0.0 -90.0 0.0")),
    *joint("JOINT", "RightUpLeg", "-9.0 -5.0 0.0", *end("0.0 -90.0 0.0")),
    *joint("JOINT", "Spine", "0.0 20.0 0.0", *joint("JOINT", "Head", "0.0 30.0 0.0", *end("0.0 15.0 2.0"))),
    channels="6 Xposition Yposition Zposition Zrotation Xrotation Yrotation",
)
Y_UP = "\n".join(["HIERARCHY", *HIPS, "MOTION", "Frames: {count}", "Frame Time: 0.0083333333", ""])


def turn(axis, deg):
    return Rotation.from_euler(axis, deg, degrees=True).as_matrix()


def matrices(quat_wxyz):
    return Rotation.from_quat(quat_wxyz, scalar_first=True).as_matrix()


def write(path, head, frames):
    lines = [" ".join(repr(float(v)) for v in frame) for frame in frames]
    path.write_text(head.replace("{count}", str(len(frames))) + "\n".join(lines) + "\n", encoding="utf-8")
    return path


def y_up_frames():
    """Hips z 5, x 3, y (yaw) 40; legs still; spine yaw -10; head z 2, x -8, y 25 degrees; walking along z."""
    legs = [0.0] * 6
    return [[10, 95, 1.0 * k, 5, 3, 40, *legs, 0, 0, -10, 2, -8, 25] for k in range(N)]


def test_y_up_zxy_by_hand(tmp_path):
    recording = load(write(tmp_path / "mia_01.bvh", Y_UP, y_up_frames()))
    hips = turn("z", 5) @ turn("x", 3) @ turn("y", 40)
    spine = hips @ turn("y", -10)
    head = spine @ turn("z", 2) @ turn("x", -8) @ turn("y", 25)
    to_out = np.array([[0, 0, 1.0], [1, 0, 0], [0, 1, 0]])  # file z is out x, file x is out y, file y is out z
    tip = hips @ [0, 20, 0] + spine @ [0, 30, 0] + head @ [0, 15, 2]
    for k in (0, N - 1):
        place = np.array([10, 95, 1.0 * k])
        np.testing.assert_allclose(recording.truth.pelvis_position_m[k], to_out @ place / 100, atol=1e-12)
        np.testing.assert_allclose(recording.truth.head_position_m[k], to_out @ (place + tip) / 100, atol=1e-12)
    # In the rest pose the person faces file z: a yaw about file y is a yaw about out z, and so on.
    np.testing.assert_allclose(matrices(recording.truth.pelvis_quat_wxyz)[3], to_out @ hips @ to_out.T, atol=1e-12)
    np.testing.assert_allclose(matrices(recording.truth.head_quat_wxyz)[3], to_out @ head @ to_out.T, atol=1e-12)
    np.testing.assert_allclose(recording.times_s, np.arange(N) / 120.0, atol=1e-7)
    assert (recording.name, recording.labels.subject, recording.labels.group) == ("mia_01", "mia", "standing")


def test_a_skeleton_lying_in_the_rest_pose_is_turned_upright(tmp_path):
    """The Y-up skeleton in a Z-up file: every frame rotates the hips by +90 deg about x."""
    head = Y_UP.replace("Zrotation Xrotation Yrotation", "Xrotation Yrotation Zrotation")
    frames = [[0, -1.0 * k, 95, 90, 30, 0, *[0.0] * 12] for k in range(N)]
    recording = load(write(tmp_path / "a.bvh", head, frames))
    np.testing.assert_allclose(recording.truth.pelvis_position_m[:, 2], 0.95, atol=1e-12)
    assert (recording.truth.head_position_m[:, 2] > 1.5).all()
    # Facing file z at rest, rotated to file -y, then 30 deg to the person's left.
    expected = turn("z", -90 + 30)
    np.testing.assert_allclose(matrices(recording.truth.head_quat_wxyz)[0], expected, atol=1e-12)


def test_options_override_values_of_the_file(tmp_path):
    path = write(tmp_path / "a.bvh", Y_UP, y_up_frames())
    usual = load(path)

    def with_options(**options):
        return load(path, ReadOptions(**options))

    np.testing.assert_allclose(with_options(bvh_frame_rate_hz=60.0).times_s, np.arange(N) / 60.0)
    larger = with_options(bvh_unit_m=0.011)
    np.testing.assert_allclose(larger.truth.head_position_m, 1.1 * usual.truth.head_position_m)
    np.testing.assert_allclose(with_options(bvh_up_axis="y").truth.head_position_m, usual.truth.head_position_m)
    spine = with_options(bvh_head_joint="spine", bvh_unit_m=0.02)
    np.testing.assert_allclose(np.linalg.norm(spine.truth.head_position_m - spine.truth.pelvis_position_m, axis=1), 0.4)
    hips = with_options(bvh_hips_joint="Spine")
    assert hips.truth.pelvis_position_m[0, 2] > usual.truth.pelvis_position_m[0, 2] + 0.15
    for option in ("bvh_head_joint", "bvh_hips_joint"):
        with pytest.raises(RecordingError, match=r"no joint 'Hand'.*Hips, LeftUpLeg, RightUpLeg, Spine, Head"):
            with_options(**{option: "Hand"})
    with pytest.raises(RecordingError, match=r"65\.\d+ m from the pelvis.*bvh_unit_m"):
        with_options(bvh_unit_m=1.0)
    with pytest.raises(RecordingError, match="bvh_unit_m"):
        with_options(bvh_up_axis="z")


def test_the_unit_of_a_sitting_person_is_that_of_the_rest_pose(tmp_path):
    """Legs lifted by 60 degrees: 1.15 m high in centimetres, implausible in any unit; 1.6 m at rest."""
    frames = [[10, 95, 1.0 * k, 0, 0, 0, 0, 60, 0, 0, 60, 0, *[0.0] * 6] for k in range(N)]
    recording = load(write(tmp_path / "a.bvh", Y_UP, frames))
    np.testing.assert_allclose(recording.truth.pelvis_position_m[:, 2], 0.95, atol=1e-12)
    assert "unit cm (1.60 m high in the rest pose)" in recording.notes[0]


@pytest.mark.parametrize(
    ("left", "right"),
    [
        ("Left_UpLeg", "RightUpLeg"),
        ("Left UpLeg", "RightUpLeg"),
        ("LftUpLeg", "RightUpLeg"),
        ("leftupleg", "rightupleg"),
    ],
)
def test_sides_are_paired_by_words(left, right, tmp_path):
    named = Y_UP.replace("LeftUpLeg", left).replace("RightUpLeg", right)
    frames = [[10, 95, 1.0 * k, *[0.0] * 15] for k in range(N)]
    assert "by left and right joints" in load(write(tmp_path / "a.bvh", named, frames)).notes[0]


def test_horizontal_legs_in_the_rest_pose_give_no_height(tmp_path):
    """Legs point backwards at rest (70 units of height, a person in inches), and down in the motion."""
    legs_back = Y_UP.replace("OFFSET 0.0 -90.0 0.0", "OFFSET 0.0 0.0 -90.0")
    frames = [[10, 95, 1.0 * k, 0, 0, 0, 0, -90, 0, 0, -90, 0, *[0.0] * 6] for k in range(N)]
    recording = load(write(tmp_path / "a.bvh", legs_back, frames))
    np.testing.assert_allclose(recording.truth.pelvis_position_m[:, 2], 0.95, atol=1e-12)
    assert "facing z at rest (by left and right joints)" in recording.notes[0]


def test_a_first_frame_in_the_rest_pose_is_dropped(tmp_path):
    frames = y_up_frames()
    recording = load(write(tmp_path / "a.bvh", Y_UP, [[0.0] * len(frames[0]), *frames]))
    plain = load(write(tmp_path / "b.bvh", Y_UP, frames))
    np.testing.assert_array_equal(recording.truth.head_position_m, plain.truth.head_position_m)


FIRST = len(Y_UP.splitlines())  # index of the first frame's line


def _line(number, text):
    return lambda lines: lines.__setitem__(number - 1, text)


def _replace(old, new):
    return lambda lines: lines.__setitem__(slice(None), [line.replace(old, new) for line in lines])


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (_line(1, "MOTION"), ["line 1", "HIERARCHY"]),
        (lambda lines: lines.__delitem__(slice(FIRST + 11, None)), [f"line {FIRST + 11}", "11 frames", "30"]),
        (lambda lines: lines.remove("}"), ["MOTION", "Hips"]),
        (_line(4, "OFFSET 0 0 nan"), ["line 4", "finite"]),
        (_line(5, "CHANNELS 1 Wrotation"), ["line 5", "Wrotation", "Xposition, Yposition"]),
        (_line(FIRST, "Frame Time: 8.3333"), ["milliseconds", "1000"]),
        (_line(FIRST + 5, "1 2 3"), [f"line {FIRST + 5}", "frame 5", "18 values"]),
        (_line(FIRST + 5, " ".join(["1"] * 17 + ["1,5"])), [f"line {FIRST + 5}", "'1,5'"]),
        (_line(FIRST + 5, " ".join(["1"] * 17 + ["nan"])), [f"line {FIRST + 5}", "Head Yrotation"]),
        (_replace("9.0 -5.0", "0.0 -5.0"), ["no pairs of left and right joints", "two sides", "bvh_facing"]),
        (_replace("-90.0", "-900.0"), ["m (1), cm (0.01), mm (0.001)", "bvh_unit_m"]),
    ],
)
def test_damage_is_reported_with_its_line(tmp_path, change, named):
    path = write(tmp_path / "walk.bvh", Y_UP, y_up_frames())
    lines = path.read_text(encoding="utf-8").splitlines()
    change(lines)
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    assert_refused(path, str(path), *named)


def test_a_person_lying_down_has_no_up_axis(tmp_path):
    frames = [[0, 95, 0, 0, 45, 0, *[0.0] * 12] for _ in range(N)]
    with pytest.raises(RecordingError, match=r"no axis points up.*bvh_up_axis"):
        load(write(tmp_path / "a.bvh", Y_UP, frames))


# ---------------------------------------------------------------- files as programs export them


def assert_walk(recording):
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
    "xsens": (sk.XSENS, {}, ["hips Hips", "by left and right joints", "60 frames per second"]),
    "biped": (sk.BIPED, {}, ["head Bip01 Head", "hips Bip01 Pelvis", "by left and right joints"]),
    "rokoko": (sk.ROKOKO, {}, ["head Head", "facing z at rest"]),
    "motion_builder": (sk.MOTION_BUILDER, {"above": "BVH:reference"}, ["hips Character1_Hips", "unit cm"]),
    "blender": (sk.BLENDER, {"axes": sk.Z_UP_FACING_MINUS_Y, "unit_m": 1.0}, ["facing -y at rest"]),
    "rigify": (
        sk.BLENDER_RIGIFY,
        {"axes": sk.Z_UP_FACING_MINUS_Y, "unit_m": 1.0, "head": "spine.006"},
        ["head spine.006 (tip of its bone, far end of the central chain)", "hips spine,"],
    ),
    "no_names": (
        sk.NUMBERED,
        {"unit_m": 0.001, "head": sk.NUMBERED_HEAD},
        ["unit mm", f"head {sk.NUMBERED_HEAD} (", "facing z at rest (by the feet)"],
    ),
}


@pytest.mark.parametrize("name", EXPORTS)
def test_exports_are_read_and_one_line_states_what_was_inferred(tmp_path, name):
    tree, how, expected_words = EXPORTS[name]
    recording = load(sk.write_bvh(tmp_path / "walk.bvh", tree, **how))
    assert_walk(recording)
    for words in [*expected_words, "the options bvh_unit_m, bvh_up_axis, bvh_head_joint"]:
        assert words in recording.notes[0]


def side_exchanged(name):
    return name.replace("Left", "?").replace("Right", "Left").replace("?", "Right")


def test_contradictory_names_and_feet_require_an_option(tmp_path):
    path = sk.write_bvh(tmp_path / "walk.bvh", sk.renamed(sk.XSENS, side_exchanged))
    with pytest.raises(RecordingError, match=r"-z at rest by left and right.*z by the feet.*bvh_facing"):
        load(path)
    recording = load(path, ReadOptions(bvh_facing="z"))
    assert_walk(recording)
    assert "facing z at rest (by bvh_facing)" in recording.notes[0]


# Without toes and names the skeleton is symmetric front to back.
NO_FEET = sk.body("0", ["1", "2"], "Head", ("a{}", "b{}"), "1 2 3", "4 5 6 7")


def test_without_feet_a_walk_gives_the_facing_and_standing_requires_an_option(tmp_path):
    recording = load(sk.write_bvh(tmp_path / "walk.bvh", NO_FEET))
    assert_walk(recording)
    assert "facing z at rest (by the direction of travel)" in recording.notes[0]
    stands = sk.write_bvh(tmp_path / "stands.bvh", NO_FEET, walks=False)
    with pytest.raises(RecordingError, match=r"no feet and no walk determine the facing.*bvh_facing"):
        load(stands)
    truth = load(stands, ReadOptions(bvh_facing="-z")).truth
    yaw = Rotation.from_quat(truth.head_quat_wxyz[0], scalar_first=True).as_euler("ZYX")[0]
    assert abs(yaw) == pytest.approx(np.pi - sk.HEAD_YAW_RAD, abs=1e-6)
    with pytest.raises(RecordingError, match=r"facing y is the direction of the head.*bvh_facing"):
        load(stands, ReadOptions(bvh_facing="y"))


def test_without_a_head_the_message_names_the_option(tmp_path):
    tree = ("A", (0, 0, 0), [("B", (0, 0, 0.4), (0.0, 0.0, 0.3))])
    with pytest.raises(RecordingError, match=r"no candidate for the head.*bvh_head_joint, one of A, B"):
        load(sk.write_bvh(tmp_path / "walk.bvh", tree, head="B"))


@pytest.mark.parametrize("named", [True, False])
def test_two_heads_require_an_option(tmp_path, named):
    hips, offset, grown = sk.XSENS if named else sk.NUMBERED
    head = "Head" if named else sk.NUMBERED_HEAD
    second = ("Prop", (0.0, 0.0, 0.2), [("Prop_Head" if named else "Bone_91", (0.3, 0.0, 0.4), (0.0, 0.0, 0.1))])
    tree = sk.renamed((hips, offset, [*grown, second]), lambda name: f"A_{name}")
    path = sk.write_bvh(tmp_path / "walk.bvh", tree, head=f"A_{head}")
    with pytest.raises(RecordingError, match=rf"candidates for the head: A_{head}, A_\w+.*bvh_head_joint"):
        load(path)
    assert_walk(load(path, ReadOptions(bvh_head_joint=f"A_{head}")))


def test_two_units_require_an_option(tmp_path):
    # Joint positions in inches and offsets in cm, a result of scaled retargeting.
    path = sk.write_bvh(tmp_path / "walk.bvh", sk.XSENS, positions_of=1 / 2.54)
    with pytest.raises(RecordingError, match=r"inch by the motion, cm by the rest pose.*bvh_unit_m"):
        load(path)
    assert "unit 0.0254 m by bvh_unit_m (1." in load(path, ReadOptions(bvh_unit_m=0.0254)).notes[0]
