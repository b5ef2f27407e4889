"""Pan-tilt cameras by ONVIF: ContinuousMove with a timeout of one second, and AbsoluteMove where offered."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any

import numpy as np

from gazempc.errors import RobotError, SettingsError, importing
from gazempc.neck.spec import AXES, NeckSpec
from gazempc.robots.options import OnvifOptions
from gazempc.robots.speed_camera import Pair, SpeedCamera


class OnvifDevice:
    """A camera by ONVIF, see `gazempc.robots.speed_camera.SpeedDevice`.

    The library onveef implements SOAP, digest authentication and the camera's clock. The move status is ignored: some
    cameras report MOVING permanently, others UNKNOWN.

    Args:
        address: HOST or HOST:PORT.
        neck: The neck, for speeds.
        options: Login, profile and directions.

    Raises:
        SettingsError: If the address is wrong, or the login cannot be read.
        MissingOptionalDependencyError: If onveef is not installed.
    """

    def __init__(self, address: str, neck: NeckSpec, options: OnvifOptions) -> None:
        with importing("the robot onvif", "onveef", "ptz"):
            import onveef  # noqa: PLC0415
        self._onveef = onveef
        host, _, port = address.partition(":")
        if not host or (port and not (port.isdecimal() and int(port) < 65536)):
            raise SettingsError(f"robot onvif:{address}: accepted: onvif:HOST, onvif:HOST:PORT")
        self._host, self._port, self._options, self._neck = host, int(port or 80), options, neck
        self._login = _login(options)
        self.name = f"onvif {host}:{self._port}"
        self._client: Any = None
        self._token, self._offered = "", list[str]()
        range_deg = options.range_deg
        self._ends_rad = None if range_deg is None else np.deg2rad(range_deg).reshape(2, 2)

    def open(self) -> None:
        """See `SpeedDevice.open`: logs in, and selects a profile with PTZ.

        Raises:
            RobotError: If it does not reply, refuses user or password, does not turn, or lacks AbsoluteMove for a
                position-controlled neck.
        """
        self._client = self._onveef.OnvifClient(self._host, self._port, *self._login, timeout_s=self._options.timeout_s)
        self._request(self._client.get_device_information)
        profiles = [each for each in self._request(self._client.get_profiles) if each.get("ptz")]
        tokens = [each["token"] for each in profiles]
        wanted = self._options.profile
        if not tokens or (wanted is not None and wanted not in tokens):
            accepted = ", ".join(tokens) or "none"
            raise RobotError(f"{self.name}: no profile {wanted or 'with PTZ'}; accepted: {accepted}")
        self._token = wanted or tokens[0]
        node = profiles[tokens.index(self._token)]["ptz"].get("node_token")
        nodes = self._request(self._client.ptz_get_nodes)
        ranges: dict[str, Any] = next((each["ranges"] for each in nodes if each.get("token") == node), {})
        self._offered = [kind for kind in ("continuous", "absolute", "relative") if f"{kind}_pan_tilt" in ranges]
        needed = "continuous" if self._neck.takes_speeds else "absolute"
        if needed not in self._offered:
            raise RobotError(f"{self.name}: it lacks {needed} moves; it offers: {', '.join(self._offered) or 'none'}")

    def drive(self, speeds_rad_s: Pair) -> None:
        """See `SpeedDevice.drive`."""
        if speeds_rad_s == (0.0, 0.0):
            self._request(self._client.ptz_stop, profile_token=self._token, pan_tilt=True, zoom=False)
            return
        pan, tilt = (
            direction * self._share(axis, speed)
            for axis, speed, direction in zip(self._neck.axes, speeds_rad_s, self._options.directions, strict=True)
        )
        # ONVIF counts pan to the right.
        # Whole seconds only; without it a camera was found to run for 180 s.
        self._request(
            self._client.ptz_continuous_move,
            profile_token=self._token, pan=-pan, tilt=tilt, zoom=None, timeout="PT1S",
        )  # fmt: skip

    def go_to(self, angles_rad: Pair) -> None:
        """Go to angles within the option `range_deg`; returns after acceptance by the camera."""
        assert self._ends_rad is not None
        low, high = self._ends_rad.T
        pan, tilt = (2.0 * (np.array(angles_rad) - low) / (high - low) - 1.0).tolist()
        self._request(self._client.ptz_absolute_move, profile_token=self._token, pan=pan, tilt=tilt, zoom=None)

    def angles_rad(self) -> Pair | None:
        """See `SpeedDevice.angles_rad`; None without the option `range_deg`."""
        if self._ends_rad is None:
            return None
        status = self._request(self._client.ptz_get_status, profile_token=self._token)
        if status.get("pan") is None or status.get("tilt") is None:
            return None
        low, high = self._ends_rad.T
        pan, tilt = (low + 0.5 * (np.array([float(status[name]) for name in AXES]) + 1.0) * (high - low)).tolist()
        return pan, tilt

    def recover(self) -> None:
        """See `SpeedDevice.recover`; calls are independent."""

    def about(self) -> list[tuple[str, str]]:
        """See `SpeedDevice.about`."""
        found = self._request(self._client.get_device_information)
        status = self._request(self._client.ptz_get_status, profile_token=self._token)
        reported = [str(found.get(name, "?")) for name in ("Manufacturer", "Model", "FirmwareVersion")]
        return [
            ("address", f"{self._host}:{self._port} (ONVIF)"),
            ("model", " ".join(reported)),
            ("profile", self._token),
            ("moves", ", ".join(self._offered)),
            ("position", f"{status.get('pan')} and {status.get('tilt')}"),
            ("move status", str((status.get("move_status") or {}).get("pan_tilt"))),
        ]

    def close(self) -> None:
        """See `SpeedDevice.close`."""
        if self._client is not None:
            self._client.close()
        self._client = None

    def _share(self, axis: Any, speed_rad_s: float) -> float:
        """Signed share of full speed for a speed."""
        if axis.speed_steps is None:
            return float(np.clip(speed_rad_s / axis.full_rad_s, -1.0, 1.0))
        steps = axis.speed_steps
        speeds = (0.0, *(steps.positive_rad_s if speed_rad_s >= 0.0 else steps.negative_rad_s))
        return float(np.sign(speed_rad_s) * np.interp(abs(speed_rad_s), speeds, np.linspace(0.0, 1.0, len(speeds))))

    def _request(self, call: Callable[..., Any], **what: Any) -> Any:
        # Messages of the library may quote a request; only the error type is passed on.
        try:
            return call(**what)
        except self._onveef.OnvifAuthError:
            hint = "set GAZEMPC_ONVIF_USER and GAZEMPC_ONVIF_PASSWORD, or --options.onvif.login FILE"
            raise RobotError(f"{self.name}: user or password refused; {hint}") from None
        except self._onveef.OnvifError as error:
            raise RobotError(f"{self.name}: {getattr(error, 'code', 'onvif_error')} ({type(error).__name__})") from None
        except Exception as error:
            raise RobotError(f"{self.name}: no valid reply ({type(error).__name__})") from None


class OnvifCamera(SpeedCamera):
    """Robot ``onvif:HOST[:PORT]``.

    Shares of speed are interpolated in the table of the neck file; without a table they are relative to the top speed.

    Args:
        address: HOST or HOST:PORT.
        neck: The neck; with position-controlled joints it needs the option ``range_deg``, and AbsoluteMove is used.
        clock_s: The loop's time, seconds.
        options: Login, profile and directions.
    """

    def __init__(self, address: str, neck: NeckSpec, clock_s: Callable[[], float], options: OnvifOptions) -> None:
        device = OnvifDevice(address, neck, options)
        go_to = None if options.range_deg is None else device.go_to
        super().__init__(device, neck, clock_s, (None, None), go_to)


def _login(options: OnvifOptions) -> tuple[str, str]:
    if options.login is None:
        return os.environ.get("GAZEMPC_ONVIF_USER", ""), os.environ.get("GAZEMPC_ONVIF_PASSWORD", "")
    try:
        user, password = options.login.read_text(encoding="utf-8").splitlines()[:2]
    except (OSError, UnicodeDecodeError) as error:
        raise SettingsError(f"options.onvif.login: {options.login} cannot be read ({type(error).__name__})") from None
    except ValueError:
        raise SettingsError(f"options.onvif.login: {options.login}: expected two lines, user and password") from None
    return user.strip(), password.strip()
