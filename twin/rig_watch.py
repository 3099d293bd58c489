"""Watches the rig by what it must do: the magnet carries the rotor, and contact begins at the wall."""

import numpy as np

from daq.rig import Rig
from simulator.dynamics import static_moment
from simulator.rig import Model
from twin.fault import Fault
from twin.walls import Walls, directed
from twin.windows import Window

LEAST_SUPPORT = 0.5  # share of the magnetic bearing's force below which it is lost
LEAST_LOAD = 0.5  # share of the static moment that the magnet would have to carry where it lies
WINDOWS = 2  # in a row
VIOLENT = 200.0  # N of the transducers' resultant above which a window is not looked at
LOUD = 15.0  # N of the transducers' resultant from which an impact is looked at
AROUND = 1e-3  # s before and behind its peak in which the shaft is deepest
APART = 5e-3  # s between two impacts' peaks


class RigWatch:
    """Looks at the balance of mean forces, and at the shaft's largest travel in impacts.

    Args:
        rig: with a model, two probes across each other and pairs of transducers.
    """

    def __init__(self, rig: Rig) -> None:
        assert rig.model is not None
        self._model: Model = rig.model
        probes = [each for each in rig.channels if each.quantity == "displacement" and each.station]
        forces = [each for each in rig.channels if each.quantity == "force" and each.station]
        across = [directed(each.angle_deg or 0.0) * (each.station or 1.0) for each in probes]
        self._to_tilt = np.linalg.pinv(np.array(across))
        # Resultant on the rotor: each transducer reads what the house pushes on it.
        self._to_force = np.array([directed(each.angle_deg or 0.0) for each in forces]).T
        self._unsupported = 0
        self._lost = False
        self._walls = Walls(self._model)

    def add(self, window: Window) -> list[Fault]:
        """Take in a window and return what it proves."""
        if not self._to_force.size:
            return []
        tilt, force = self._to_tilt @ window.probes, -self._to_force @ window.forces
        if np.hypot(*force).max() > VIOLENT:
            return []
        return self._support(tilt, force, window) or self._contact(tilt, force, window)

    def forget(self) -> None:
        """Learn what is usual anew."""
        self._unsupported = 0
        self._walls.forget()

    def _support(self, tilt: np.ndarray, force: np.ndarray, window: Window) -> list[Fault]:
        """Return whether the magnetic bearing is lost, by the mean balance of vertical moments."""
        rotor, magnet = self._model.rotor, self._model.magnetic_bearing
        needed = static_moment(rotor) + rotor.bearing_station * float(force[1].mean())
        carried = magnet.stiffness * rotor.magnet_station**2 * float(tilt[1].mean())
        if magnet.stiffness == 0.0 or abs(carried) < LEAST_LOAD * abs(static_moment(rotor)):
            self._unsupported = 0
            return []
        share = needed / carried
        self._unsupported = self._unsupported + 1 if share < LEAST_SUPPORT else 0
        if self._unsupported < WINDOWS or self._lost:
            return []
        self._lost = True
        onset = window.end - WINDOWS * (window.end - window.first_sample)
        return [Fault("magnet", "", max(0.0, share), "", 1.0, onset)]

    def _contact(self, tilt: np.ndarray, force: np.ndarray, window: Window) -> list[Fault]:
        """Return whether a wall stands elsewhere than it did."""
        station, around = self._model.rotor.bearing_station, round(AROUND * window.rate)
        for peak in peaks(np.hypot(*force), window.rate):
            stretch = slice(max(0, peak - around), peak + around)
            resultant = float(np.hypot(*force[:, stretch]).max())
            self._walls.meet(station * tilt[:, stretch], resultant, window.first_sample + peak)
        return self._walls.judge(window.end, window.rate)


def peaks(resultant: np.ndarray, rate: float) -> list[int]:
    """Return where impacts are largest: samples of the highest `resultant` (n,), N, `APART` at least."""
    loud = np.flatnonzero(resultant > LOUD)
    if not loud.size:
        return []
    impacts = np.split(loud, np.flatnonzero(np.diff(loud) > APART * rate) + 1)
    return [int(each[np.argmax(resultant[each])]) for each in impacts]
