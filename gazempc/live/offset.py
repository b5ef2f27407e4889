"""Capture times of a clock that is ahead, far behind or fast: found out from the stream, and made up for."""

from __future__ import annotations

from gazempc.live.envelope import Envelope
from gazempc.live.watch.frame import Finding, shown
from gazempc.live.watch.mends import Mends
from gazempc.loop.events import Event

# Two clocks that agree still differ by this much.
_AGREE_S = 0.01
# No tracker is so slow. Between this and what is stale it may be the tracker as well as the clock.
_SLOWEST_S = 2.0


class ClockOffset:
    """Watches how late frames are by their stamps, and shifts capture times that cannot be.

    Frames from the future, and from more than 2 s ago, are of another clock. So are those that come sooner and sooner.
    The age that was believed before is kept; without any the soonest frames are taken to be `latency_s` old. A clock
    that is slow is not told from a tracker that falls behind: nothing is done about it.

    Args:
        latency_s: Least time from capture to arrival, seconds.
        mends: Names what mends it.

    Attributes:
        age_s: How old the soonest frames are by their stamps, seconds; negative if they are of the future.
        finding: What is made up for, and what mends it; None if nothing is.
    """

    def __init__(self, latency_s: float, mends: Mends) -> None:
        self.age_s = 0.0
        self.finding: Finding | None = None
        self._latency_s, self._mends = latency_s, mends
        self._envelope = Envelope()
        self._resets = 0
        self._usual_s: float | None = None
        self._believed_s = latency_s

    def shift_s(self, arrival_s: float, capture_s: float) -> float:
        """Take note of a frame.

        Args:
            arrival_s: When it arrived, seconds.
            capture_s: Its time of capture as stated, on the loop's clock, seconds.

        Returns:
            What to add to the time of capture, seconds; 0 where the clock is believed.
        """
        envelope = self._envelope
        envelope.add(arrival_s, arrival_s - capture_s)
        self.age_s = envelope.at(arrival_s)
        if envelope.resets != self._resets:
            self._resets, self._usual_s, self.finding = envelope.resets, None, None
        if envelope.steady and self.finding is None:
            self._judge(envelope.recent_s, envelope.slope)
        return 0.0 if self.finding is None else self.age_s - self._believed_s

    def _judge(self, recent_s: float, slope: float) -> None:
        if not -_AGREE_S <= recent_s <= _SLOWEST_S:
            off_s = self._believed_s - self.age_s
            self._shift(f"is {shown(abs(off_s))} s {'ahead' if off_s > 0 else 'behind'}")
        elif self._usual_s is None:
            self._usual_s = self._believed_s = self.age_s
        elif slope < 0.0:
            self._shift(f"runs {-100 * slope:.1f} % fast")

    def _shift(self, how: str) -> None:
        text = (
            f"the tracker's clock {how}: capture times are shifted, so that the soonest frames are "
            f"{max(self._believed_s, 0.0):.2f} s old; set the clocks of both computers by NTP, or "
            f"{self._mends.stamps('other')}"
        )
        self.finding = Finding(Event.CLOCK_SHIFTED, text)
