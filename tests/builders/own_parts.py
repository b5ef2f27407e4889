"""A module with user-defined parts."""

import sys

MODULE = """
from gazempc.controllers.lookahead import LookAhead
from predictors import ConstantVelocity


class Sluggish(LookAhead):
    \"\"\"Looks ahead for a share of the time only.\"\"\"

    name = "sluggish"

    def __init__(self, neck, share: float = 0.5) -> None:
        super().__init__(neck)
        self._share = share

    def forecast_times_s(self, start_s, newest_capture_s):
        return start_s + self._share * (super().forecast_times_s(start_s, newest_capture_s) - start_s)


class Steady(ConstantVelocity):
    \"\"\"The filter under another name.\"\"\"

    name = "steady"

    def __init__(self, psd: float = 0.05) -> None:
        super().__init__(psd, 0.01)


class Failing(Steady):
    \"\"\"Fails after fifty forecasts.\"\"\"

    name = "failing"
    calls = 0

    def forecast(self, times_s):
        self.calls += 1
        if self.calls > 50:
            raise TypeError("too often")
        return super().forecast(times_s)
"""


def own_module(folder, monkeypatch, name="my_parts", more=""):
    """Write the module into a folder that becomes the working directory; returns its name."""
    (folder / f"{name}.py").write_text(MODULE + more)
    monkeypatch.chdir(folder)
    monkeypatch.syspath_prepend(str(folder))
    monkeypatch.delitem(sys.modules, name, raising=False)
    return name
