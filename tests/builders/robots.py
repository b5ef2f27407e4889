"""Robots with injected faults."""


class Spied:
    """A robot that records its commands and whose answers can be replaced.

    `on_read(now_s, state)` and `on_send(now_s)` may raise, or return the answer that replaces the truth (`on_send`
    as the only element of a tuple); what `on_send` does not answer reaches the neck.
    """

    def __init__(self, inner, clock, on_read=None, on_send=None):
        self.inner, self.clock, self.on_read, self.on_send = inner, clock, on_read, on_send
        self.received, self.calls = [], []
        self.true_state = inner.true_state

    def connect(self):
        self.calls.append("connect")
        self.inner.connect()

    def read_state(self):
        state = self.inner.read_state()
        return state if self.on_read is None else self.on_read(self.clock.now_s(), state)

    def send_command(self, position_rad):
        if self.on_send is not None:
            answered = self.on_send(self.clock.now_s())
            if answered is not None:
                return answered[0]
        sent = self.inner.send_command(position_rad)
        self.received.append((self.clock.now_s(), sent.copy()))
        return sent

    def close(self):
        self.calls.append("close")
        self.inner.close()


def with_both(neck, **changes):
    """A neck with other values for pan and tilt."""
    return neck.with_axes({name: getattr(neck, name).model_copy(update=changes) for name in ("pan", "tilt")})
