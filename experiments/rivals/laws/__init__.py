"""The control laws of robots and cameras, and their table by name. May import experiments.rivals."""

from experiments.rivals.laws.autoptz import AutoPtz
from experiments.rivals.laws.frigate import Frigate
from experiments.rivals.laws.humanoids import Humotion, IKinGazeCtrl
from experiments.rivals.laws.op3 import Op3
from experiments.rivals.laws.pixel_pid import ObsFaceTracker, PixelPid
from experiments.rivals.laws.pr2_point_head import Pr2PointHead
from experiments.rivals.laws.reachy_mini import ConversationApp, ReachyMini, ReachyMiniCaptureRaw
from experiments.rivals.laws.smith import Smith, SmithFeedForward
from experiments.rivals.rival import Rival

# Each makes a law of a neck, a camera and its own constants.
RIVALS: dict[str, type[Rival]] = {
    law.name: law
    for law in (
        ReachyMini,
        ReachyMiniCaptureRaw,
        ConversationApp,
        AutoPtz,
        Frigate,
        Op3,
        IKinGazeCtrl,
        Humotion,
        Pr2PointHead,
        PixelPid,
        ObsFaceTracker,
        Smith,
        SmithFeedForward,
    )
}
