"""The Gymnasium environment: a batch of one world."""

from typing import Any, Literal, Unpack, cast

import gymnasium
import numpy as np
from numpy.typing import NDArray

from pter_gym._internal.checks import whole_number
from pter_gym.envs._mixin import Arguments, WorldsMixin
from pter_gym.errors import ParameterError
from pter_gym.params import Machine
from pter_gym.plugins import load_artist
from pter_gym.tasks.path_following import COLUMN, PathFollowing

RenderMode = Literal["human", "rgb_array"]


class PathFollowingEnv(WorldsMixin, gymnasium.Env[NDArray[np.float32], NDArray[np.float32]]):  # pyright: ignore[reportIncompatibleVariableOverride]
    """A hand pushes a passive planar arm along a path; four friction clutches keep it there.

    ## Description
    PTER is a planar five-bar arm without motors (Swanson, Romagna, Book and Barraco, Georgia Tech,
    1999). A person pushes its handle. Four electromagnetic friction clutches brake or couple its
    two axes: clutch 1 brakes link A against the ground, clutch 2 link B, clutch 3 couples A to B,
    and clutch 4 couples A to B through a gear that inverts the motion. A clutch only removes
    energy, so no action of an agent can push the hand. Clutches stick and slip (Karnopp's model),
    and their torque lags the voltage with a time constant of about 0.1 s.

    The hand's force is the paper's: a constant push along the path and the multi-sine of Eq. 5
    across it.

    ## Action Space
    `Box(-1, 1, (4,), float32)`, an entry for each clutch: `a` is mapped to `((a + 1) / 2)**2` times
    the machine's largest voltage, for fine resolution at the low voltages where clutches slip; -1
    is 0 V. With `action_unit="volt"`, `Box(0, 24, (4,), float32)`: the voltages themselves. Values
    up to four float32 ulp out of bounds are clipped; values further out, NaN or a wrong shape raise
    `ActionError`, and nothing moves. A machine with fewer clutches has fewer entries: with two
    brakes, the space is `Box(-1, 1, (2,), float32)`.

    ## Observation Space
    `Box(-25, 25, (20,), float32)` with encoders only, 24 entries with torque sensors, 26 with force
    sensors. Entries are scaled so that typical values are between -1 and 1, and clipped to ±25;
    `env.unwrapped.observation_layout` has their names and scales:

    | entries | meaning |
    |---|---|
    | `cos_a`, `sin_a`, `cos_b`, `sin_b` | absolute angles of links A and B |
    | `omega_a`, `omega_b` | their angular velocities |
    | `normal_error` | signed distance from the path, or from the edge of its free band |
    | `near_error` | signed distance from the path itself, clipped to ±10 mm |
    | `progress` | fraction of the path covered |
    | `heading_cos`, `heading_sin`, `curvature` | the path there |
    | `speed_along`, `speed_across` | tip velocity along and across the path |
    | `pace`, `pace_error` | commanded mean speed; `speed_along` divided by it, minus 1 |
    | `volts_1`, `volts_2`, `volts_3`, `volts_4` | last voltages; 0 for a missing clutch |
    | `torque_1`, `torque_2`, `torque_3`, `torque_4` | generated torques (`"torque"`, `"force"`) |
    | `force_along`, `force_across` | the hand's force (`sensors="force"`) |

    ## Rewards
    New distance along the path is rewarded: 100 for the whole path if the tip stays on it and keeps
    the commanded pace. The reward falls with the distance e from the path as exp(-abs(e) / 60 mm),
    and with the ratio x of the pace (averaged over 0.1 s) to the commanded one as x³ below 1 and
    x⁻⁴ above. A wrong pace also costs something each second; standing still for as long as the path
    should take costs 50. Leaving the workspace or missing the end of the path costs half of what
    the episode has earned so far. A step earns at most what its new arc length is worth, so no
    episode earns more than 100. Voltages cost in proportion to their mean square: 20 with all
    clutches at the largest voltage for as long as the path should take, 4 to 6 in an episode of a
    good policy. The weights are in `task.reward`, which can also penalise the tip's acceleration.
    Each term is in the telemetry.

    `info["telemetry"]` is a float64 array in the order of `env.unwrapped.telemetry_layout` (pose,
    tip, force, mode, volts, generated torques and powers, energy terms, reward terms);
    `info["is_success"]` tells whether the tip has reached the end of the path.

    ## Starting State
    At rest at the start of the path, with the clutches released. With `task.start_offset` the tip
    starts at a uniformly drawn distance from the path, and with `task.hand.random_phases` the
    phases of the disturbance are drawn; both depend only on the seed. A reset without a seed starts
    the next episode of the current seed.

    With `task.starts`, for training, some episodes begin anywhere along the path, off it and
    moving, and others at its start with the clutches settled at random voltages; see
    `pter_gym.tasks.path_following.Starts`. Test episodes never do.

    ## Episode End
    ### Termination
    The tip reaches the end of the path (`is_success` if it is within `task.arrival`, 0.125 m, of
    it), or leaves the workspace: too far from the path, behind its start, or near a singular pose.
    An episode also ends if the arm becomes too fast for the simulator, many times faster than any
    hand moves it. `pter_gym.tasks.path_following.reason_of` says why an episode has ended.

    ### Truncation
    After 1000 steps of the environment, by Gymnasium's `TimeLimit`; or when the tip is further than
    `task.truncation_error` from the path, or that far behind its start. By default that is beyond
    any workspace, so the workspace ends the episode first.

    ## Arguments
    - `machine`: a `Machine`, the name of one of `pter_gym.params.MACHINES`, or its file.
    - `task`: a `PathFollowing`: path, hand, pace, control period, workspace, truncation error,
      arrival, starts, failures, sensing, reward weights.
    - `path`, `hand`, `pace`, `reward`, `error_max`, `truncation_error`, `starts`, `failures`:
      fields of a task in place of `task`. `path` is a `Path`, its name in `pter_gym.paths.PATHS` or
      a CSV file of waypoints, and the workspace about a curved one is as wide as its curvature
      allows; `hand` is an `Operator` or its name, as `pter_gym.hands.find_hand` takes it; `pace` is
      in m/s or a name in `pter_gym.scenarios.PACES`; `starts` may be a name in
      `pter_gym.tasks.path_following.STARTS`; `failures` are clutches that fail, such as
      `[Failure(clutch=2, torque=0.0, after=0.5)]`, or with `scenario` a distribution of them.
    - `scenario`: what each episode draws its machine and task from, as for `PTER/Standard-v0`: a
      name in `pter_gym.scenarios.SCENARIOS`, a `Scenario`, or your own `Draws`
      (`pter_gym.scenarios.distributions`). `machine`, `path`, `hand` and the other fields then
      replace what is drawn; the phases of a hand's sines, and hands that fit the log of a measured
      one, are drawn. By default actions are held for 3 control steps, the pace is drawn between the
      slowest and the fastest named one, and episodes of a named scenario begin anywhere along the
      path, moving; with `starts="rest"` they begin like test episodes, so an exploring agent sees
      little of the path.
    - `contexts`, `context_seed`: number of pairs of machine and task that a scenario's episodes
      draw from, 512 by default, and the seed of their list.
    - `observe_context`: whether the observation ends with the context of machine and task (time
      constant, torque and friction drift of the clutches, what the hand adds). The telemetry always
      includes it.
    - `sensors`: `"encoders"`, `"torque"` (default) or `"force"`.
    - `action_unit`: `"normalised"` (default) or `"volt"`.
    - `frame_skip`: control steps (of 10 ms) for which an action is held, 1 by default. Rewards and
      reward terms of these steps add up; the observation and the rest of `info` are those of the
      last one. If the episode ends on the way, the step ends there.
    - `base`: a control law whose voltages actions correct, by name, such as `"single-dof-tuned"`,
      or a `Controller`. The law acts at every control step, the observation ends with its
      voltages, `base_1` to `base_4`, and with a scenario actions are held for one control step by
      default.
    - `reach`: what an action of 1 adds to the base's voltage, by default a third of the largest
      voltage, 8 V.
    - `history`: rising numbers of control steps, such as `(1, 3, 10)`. The observation ends with
      the whole observations of that many control steps ago, with entries such as
      `normal_error[-3]`. Control steps are 10 ms whatever `frame_skip` is, so the agent also sees
      observations from within its last action. Entries from before the start of an episode repeat
      its first observation.
    - `privileged`: whether `info["privileged"]` holds what no sensor shows: the exact state of arm,
      clutches and hand, and the constants of machine, hand and task, in the order and units of
      `env.unwrapped.privileged_layout`, which also has scales. It is for value networks in
      training; a policy never sees it.
    - `render_mode`: `"human"` (needs the extra `render`) or `"rgb_array"`.
    - `width`, `height`: size of the pictures, 840 × 600 pixels by default.

    ## Version History
    - v0: initial version.
    """

    metadata: dict[str, Any] = {"render_modes": ["human", "rgb_array"], "render_fps": 100}  # noqa: RUF012

    def __init__(
        self,
        *,
        render_mode: RenderMode | None = None,
        width: int = 840,
        height: int = 600,
        **arguments: Unpack[Arguments],
    ) -> None:
        self.observation_space, self.action_space = self._make_worlds(1, render_mode, arguments)
        self.render_mode = render_mode
        self._seeded_by: np.random.Generator | None = None
        self._rows: list[NDArray[np.float64]] = []
        self._viewer: Any = None
        if render_mode is not None:
            self._viewer = load_artist("world")(self.machine, self.task, render_mode, width, height)

    @property
    def machine(self) -> Machine:
        """The machine of the current episode."""
        return self.batch.pairs[self.batch.context[0]][0]

    @property
    def task(self) -> PathFollowing:
        """The task of the current episode."""
        return self.batch.pairs[self.batch.context[0]][1]

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Start a new episode; without a seed, the next one of the current seed.

        A generator that was assigned to ``np_random`` gives the seed of the next episode,
        ``np_random_seed``.

        Raises
        ------
        ParameterError
            If the seed is not a whole number within [0, 2⁶⁴), or there are options.
        """
        if options or not isinstance(cast("object", options), dict | None):
            raise ParameterError(f"options must be empty, got {options!r:.200}")
        if seed is not None:
            seed = whole_number("seed", seed, at_least=0)
            obs, telemetry = self.batch.reset([seed])
            super().reset(seed=seed)
        elif self._np_random is None or self._np_random is not self._seeded_by:
            self._np_random_seed = int(self.np_random.integers(2**63))
            obs, telemetry = self.batch.reset([self._np_random_seed])
        else:
            obs, telemetry = self.batch.reset([None])
        self._seeded_by = self._np_random
        if self._viewer is not None:
            self._rows = []
            if len(self.batch.pairs) > 1:
                self._viewer.look_at(self.machine, self.task)
            self._show(telemetry[0])
        return obs[0], self._info(telemetry[0], success=False)

    def step(self, action: Any) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Advance by ``frame_skip`` control periods.

        Raises
        ------
        ActionError
            If the action has a wrong shape or type, is not finite, or is out of bounds; nothing has
            moved.
        ResetNeededError
            Before the first reset and after the end of an episode.
        """
        obs, row, reward, terminated, truncated, success = self.batch.step_alone(action)
        if self._viewer is not None:
            self._show(row)
        return obs, reward, terminated, truncated, self._info(row, success=success)

    def render(self) -> NDArray[np.uint8] | None:
        """Return a picture (height, width, 3) with ``rgb_array``; ``human`` shows each step."""
        if self._viewer is None:
            gymnasium.logger.warn(
                "render_mode was not given to gymnasium.make; nothing is rendered"
            )
            return None
        if not self._rows:
            raise gymnasium.error.ResetNeeded("render needs a reset before it")
        return self._draw() if self.render_mode == "rgb_array" else None

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._viewer is not None:
            self._viewer.close()

    def _info(self, telemetry: NDArray[np.float64], *, success: bool) -> dict[str, Any]:
        told = {"privileged": self.batch.privileged()[0]} if self.worlds.privileged else {}
        return {"telemetry": telemetry, "is_success": success, **told}

    def _show(self, row: Any) -> None:
        self._rows.append(row)
        if self.render_mode == "human":
            self._draw()

    def _draw(self) -> NDArray[np.uint8] | None:
        rows: Any = np.array(self._rows)
        return self._viewer.draw(rows[-1], rows[:, [*COLUMN.tip]])
