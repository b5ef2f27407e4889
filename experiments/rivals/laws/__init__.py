"""The control laws of robots and cameras, and their table by name. May import experiments.rivals."""

from experiments.rivals.laws.cameras import AutoPtz, ObsFaceTracker, PixelPid
from experiments.rivals.laws.frigate import Frigate
from experiments.rivals.laws.reachy_mini import ConversationApp, ReachyMini, ReachyMiniCaptureRaw
from experiments.rivals.laws.robots import Humotion, IKinGazeCtrl, Op3, Pr2PointHead
from experiments.rivals.laws.smith import Smith, SmithFeedForward
from experiments.rivals.rival import Rival

# Constructors of the laws: models of neck and camera, and constants.
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
