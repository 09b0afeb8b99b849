"""When a number of a scene is evaluated, and where an obstacle is then.

The load path is a line from ``t = 0``, the unloaded bodies, to the number of load steps;
load step k ends at ``t = k + 1``. `Histories` evaluates the numbers of a scene at the ends
of some steps on this line, and the motion of obstacles up to there.
"""

from __future__ import annotations

import numpy as np

from bipot_rs._lib.types import Floats
from bipot_rs.contact.path.moving_gaps import MovingGaps
from bipot_rs.fem.assembly.assembly import Assembly
from bipot_rs.obstacle.motion import Motion
from bipot_rs.scene.schema.contact import Rigid
from bipot_rs.scene.schema.load import Amplitude
from bipot_rs.scene.schema.root import Scene
from bipot_rs.scene.schema.table import Varying


class Histories:
    """The numbers of a scene at the ends of steps.

    Between load steps, tables are interpolated linearly and waves evaluated. In the first
    load step all numbers grow linearly from zero; without an amplitude they then stay
    constant.

    ``scene``: the scene.
    ``ends (steps,)``: ends of the steps, from 0 to the number of load steps; the default is the
    ends of the load steps.
    Raises `ValueError`: an end is outside the path.
    """

    def __init__(self, scene: Scene, ends: Floats | None = None) -> None:
        count = scene.path.count()
        self.ends = np.arange(1.0, count + 1) if ends is None else ends
        if not ((self.ends >= 0) & (self.ends <= count)).all():
            raise ValueError(
                f"t is {self.ends.tolist()}, expected values from 0 to {count}, the number "
                "of load steps"
            )
        self._scene = scene
        self._factors = {
            name: evaluate_amplitude(amplitude, self.ends, count)
            for name, amplitude in scene.path.amplitude.items()
        }

    def evaluate(self, number: Varying) -> Floats:
        """A number times its amplitude, ``(steps,)``."""
        name = number.amplitude
        return number.value * (
            self._factors[name] if name else number.constant(self.ends)
        )

    @property
    def parameter(self) -> Floats:
        """The path parameter of the scene, ``(steps,)``; without one `ends`."""
        name = self._scene.path.parameter
        return self.ends.astype(np.float64) if name is None else self._factors[name]

    def prescribe(self, model: Assembly) -> Floats:
        """Displacements of supports, remote points and bolts, ``(steps, len(model.fixed))`` [m]."""
        rows = [
            [self.evaluate(v) for v in support.components().values()]
            for support in self._scene.support
        ]
        points = {}
        for name, remote in self._scene.remote.items():
            if not remote.distributed:
                settings = remote.given()
                points[name] = [
                    *(self.evaluate(v) for v in settings.get("move", {}).values()),
                    *(
                        np.deg2rad(self.evaluate(v))
                        for v in settings.get("turn", {}).values()
                    ),
                ]
        for bolt in self._scene.bolt:
            # NaN where the force determines the shortening.
            points[bolt.title] = [np.where(bolt.is_tightened(self.ends), np.nan, 0.0)]
        prescribed = [
            model.prescribed(
                [[float(h[step]) for h in row] for row in rows],
                {name: [float(h[step]) for h in row] for name, row in points.items()},
            )
            for step in range(len(self.ends))
        ]
        return np.array(prescribed).reshape(len(self.ends), len(model.fixed))

    def make_motions(self) -> dict[str, Motion | None]:
        """Motion of each obstacle up to each of the ends; None if it is at rest."""
        return {name: self._make_motion(r) for name, r in self._scene.obstacle.items()}

    def _make_motion(self, rigid: Rigid) -> Motion | None:
        if rigid.move is None and rigid.turn is None:
            return None
        turn = rigid.turn
        about = turn.about if turn is not None and turn.about else rigid.centre
        axis = None if turn is None else turn.axis
        moved = rigid.given().get("move", {})
        # The file of a surface may not have been read: z or an axis means three dimensions.
        in_space = 2 in moved or axis is not None
        dim = len(about) if about else 3 if in_space else 2
        translation = np.zeros((len(self.ends), dim))
        for k, number in moved.items():
            translation[:, k] = self.evaluate(number)
        return Motion(
            translation,
            None if turn is None else self.evaluate(turn.angle),
            about=None if turn is None else about,
            axis=axis,
            degrees=True,
        )

    def find_gaps(self, model: Assembly) -> Floats | MovingGaps | None:
        """Gaps where obstacles are at each of the ends; None if no obstacle moves."""
        scene = self._scene

        def move(before: int, end: float) -> list[Motion | None]:
            moving = Histories(
                scene, np.array([before, end], np.float64)
            ).make_motions()
            return [moving.get(c.obstacle or "") for c in scene.contact]

        return model.gaps_at(self.ends, scene.path.count(), move)


def evaluate_amplitude(amplitude: Amplitude, t: Floats, steps: int) -> Floats:
    """Factors at ``t``, of a path of some load steps."""
    if amplitude.table is not None:
        at_ends = np.array(amplitude.table)
    elif amplitude.wave == "ramp":
        at_ends = np.arange(1.0, steps + 1) / steps
    else:
        turns = np.arange(steps) / (amplitude.period or 1.0)
        at_ends = np.sin(2 * np.pi * turns)
    values = np.concatenate([[0.0], at_ends])
    whole = np.floor(t).astype(np.int64)
    share = t - whole
    before, after = values[whole], values[np.minimum(whole + 1, steps)]
    between = (1 - share) * before + share * after
    if amplitude.wave == "ramp":
        between = t / steps
    elif amplitude.wave == "sine":
        turns = (t - 1) / (amplitude.period or 1.0)
        between = np.where(whole > 0, np.sin(2 * np.pi * turns), between)
    # At the ends of load steps bitwise equal to the factors there.
    return np.where(share == 0, before, between)
