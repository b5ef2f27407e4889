"""The names of `import gazempc`, for type checkers and for `gazempc.__getattr__`: one name a line."""

from gazempc.controllers.controller import Plan as Plan
from gazempc.controllers.controller import Situation as Situation
from gazempc.controllers.lookahead import LookAhead as LookAhead
from gazempc.controllers.mpc.mpc import Mpc as Mpc
from gazempc.controllers.reactive import Reactive as Reactive
from gazempc.errors import GazempcError as GazempcError
from gazempc.front import replay as replay
from gazempc.live.gaze import Gaze as Gaze
from gazempc.neck.picture import Framing as Framing
from gazempc.neck.spec import NeckSpec as NeckSpec
from gazempc.neck.spec import load_neck as load_neck
from gazempc.recordings.load import load_recording as load_recording
from gazempc.recordings.load import recording_from_arrays as recording_from_arrays
from gazempc.recordings.recording import Recording as Recording
from gazempc.results.log import Log as Log
from gazempc.results.log_files import load_log as load_log
from gazempc.results.metrics import Metrics as Metrics
from gazempc.results.metrics import measure as measure
from gazempc.sim.sensing.spec import SensorSpec as SensorSpec
from gazempc.sim.sensor import load_sensor as load_sensor
from gazempc.types import JointState as JointState
from predictors import ConstantVelocity as ConstantVelocity
from predictors import Forecast as Forecast
from predictors import HeadObservation as HeadObservation
from predictors import Walker as Walker
from predictors import bearing_covariance as bearing_covariance
