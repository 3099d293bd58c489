import numpy as np
import pytest

from daq import keys
from daq.messages import Series, decode_series
from daq.rig import Rig, load_rig
from simulator.clearance import bearing_edge
from tests.twin.drawn_run import FORCE_SIGMA, SIGMA, SPEED_HZ, messages, motion
from twin.display_data import BIN, Scene, Stretches, Trail, largest
from twin.display_geometry import ruler, sensors_of, view_radius

MICRO = 1e6


@pytest.fixture(scope="module")
def rig() -> Rig:
    return load_rig("thesis-ball")


@pytest.fixture(scope="module")
def run(rig: Rig) -> list[tuple[str, Series]]:
    wanted = (keys.block(rig.name), keys.estimate(rig.name))
    return [(key, decode_series(payload)) for key, payload in messages(rig, "run", 5.0) if key in wanted]


def feed(scene: Scene, run: list[tuple[str, Series]], per_frame: int) -> list:
    """Frames made after each `per_frame` messages."""
    frames = []
    for number, (key, series) in enumerate(run, start=1):
        (scene.add_block if key.endswith("block") else scene.add_estimate)(series)
        if number % per_frame == 0:
            frames.append(scene.frame())
    return [*frames, scene.frame()]


def joined(frames: list, name: str) -> tuple[np.ndarray, np.ndarray]:
    parts = [frame.curves[name] for frame in frames if name in frame.curves]
    return np.concatenate([part.times for part in parts]), np.concatenate([part.values for part in parts])


class TestBearingEdge:
    def test_of_a_ball_bearing_is_a_circle_of_the_clearance(self, rig):
        (circle,) = bearing_edge(rig.model)
        assert np.hypot(*circle.T) == pytest.approx(1.5e-3)
        assert circle[0] == pytest.approx(circle[-1])

    def test_of_a_pinned_bearing_has_the_gap_on_the_diagonals_and_cusps_on_the_axes(self, rig):
        bearing = rig.model.backup_bearing._replace(kind=2, pin_tip_radius=4e-3)
        arcs = bearing_edge(rig.model._replace(backup_bearing=bearing))
        assert len(arcs) == 4
        for arc in arcs:
            assert np.hypot(*arc[len(arc) // 2]) == pytest.approx(1.5e-3)  # under the pin
            assert np.hypot(*arc[0]) == pytest.approx(2.228e-3, abs=1e-6)  # the cusp, physics section 4
        assert arcs[0][-1] == pytest.approx(arcs[1][0], abs=1e-12)  # neighbours meet there

    def test_of_pins_too_far_apart_leaves_the_axes_open(self, rig):
        bearing = rig.model.backup_bearing._replace(kind=2, clearance=0.02, pin_tip_radius=1e-3)
        arcs = bearing_edge(rig.model._replace(backup_bearing=bearing))
        assert all(np.isfinite(arc).all() for arc in arcs)
        assert np.hypot(*(arcs[0][-1] - arcs[1][0])) > 1e-3

    def test_and_the_trip_level_fit_into_the_view(self, rig):
        assert view_radius(rig) > max(1.5e-3, rig.limits.displacement.trip)


class TestRuler:
    @pytest.mark.parametrize("reach", [3.0, 95.0, 1800.0, 2280.0, 9999.0])
    def test_marks_are_round_few_and_symmetric(self, reach):
        marks = ruler(reach)
        assert marks == pytest.approx(-marks[::-1])
        assert 0 not in marks
        assert 2 <= len(marks) <= 8
        first = f"{marks[marks > 0][0]:e}"
        assert first[0] in "125"
        assert set(first[1:].partition("e")[0]) <= set(".0")


class TestSensors:
    def test_are_found_by_quantity(self, rig):
        sensors = sensors_of(rig)
        names = rig.channels.names
        assert names[sensors.speed] == "motor_speed"
        assert names[sensors.speed_command] == "motor_speed_command"
        assert names[sensors.angle] == "encoder_angle"
        assert sensors.displacement is not None
        assert sensors.force is not None


class TestStretches:
    def test_hands_out_whole_bins_and_keeps_the_rest(self):
        stretches = Stretches(4)
        stretches.add(0, 5, np.zeros((1, 6), np.float32))
        ((indices, columns),) = stretches.take()
        assert indices.tolist() == [0, 5, 10, 15]
        assert columns.shape == (1, 4)
        stretches.add(30, 5, np.ones((1, 2), np.float32))
        ((indices, columns),) = stretches.take()
        assert indices.tolist() == [20, 25, 30, 35]
        assert columns.tolist() == [[0, 0, 1, 1]]

    def test_starts_anew_after_a_gap(self):
        stretches = Stretches(4)
        stretches.add(0, 1, np.zeros((1, 6), np.float32))
        stretches.add(100, 1, np.ones((1, 5), np.float32))
        first, second = stretches.take()
        assert first[0].tolist() == [0, 1, 2, 3]
        assert second[0].tolist() == [100, 101, 102, 103]

    def test_gives_nothing_when_nothing_came(self):
        assert Stretches(4).take() == []


class TestLargest:
    def test_keeps_a_peak_of_one_sample_with_its_sign(self):
        bins = np.zeros((1, 2, 50))
        bins[0, 0, 17], bins[0, 1, 3] = -90.0, 40.0
        assert largest(bins).tolist() == [[-90.0, 40.0]]


class TestTrail:
    def test_forgets_what_is_older_than_its_longest(self):
        trail = Trail()
        for second in range(3):
            times = second + np.arange(1000) / 1000
            trail.add(times, np.vstack((times, times)))
        orbit = trail.orbit(10.0, np.array([0.5, 2.5]))
        assert orbit.path[0, 0] >= 1.9
        assert orbit.path[-1, 0] == pytest.approx(2.999)
        assert orbit.marks == pytest.approx(np.array([[2.5, 2.5]]))

    def test_does_not_bridge_a_gap(self):
        trail = Trail()
        trail.add(np.arange(100) / 1000, np.zeros((2, 100)))
        trail.add(0.3 + np.arange(100) / 1000, np.ones((2, 100)))
        assert trail.orbit(1.0, np.empty(0)).path.min() == 1.0

    def test_is_nothing_before_the_first_point(self):
        assert Trail().orbit(1.0, np.empty(0)) is None


class TestScene:
    def test_curves_do_not_depend_on_how_the_run_is_cut_into_frames(self, rig, run):
        one, other = feed(Scene(rig), run, 1), feed(Scene(rig), run, 37)
        for name in (
            "displacement/measured",
            "displacement/twin",
            "displacement/band",
            "force/transducers",
            "force/twin",
            "force/band",
            "speed",
        ):
            for left, right in zip(joined(one, name), joined(other, name), strict=True):
                assert left == pytest.approx(right)

    def test_displacement_is_that_of_the_shaft_at_the_bearing_in_micrometres(self, rig, run):
        times, values = joined(feed(Scene(rig), run, 20), "displacement/measured")
        assert np.diff(times) == pytest.approx(BIN)
        middle = motion(times + BIN / 2)
        assert values[:, 0] == pytest.approx(MICRO * middle.x, abs=5.0)
        assert values[:, 1] == pytest.approx(MICRO * middle.y, abs=5.0)

    def test_force_is_the_resultant_and_speed_is_in_hertz(self, rig, run):
        frames = feed(Scene(rig), run, 20)
        assert joined(frames, "force/transducers")[1].max() == pytest.approx(60.0, rel=1e-3)
        assert joined(frames, "force/twin")[1].max() == pytest.approx(60.0, rel=1e-3)
        assert joined(frames, "speed")[1] == pytest.approx(SPEED_HZ, rel=1e-6)

    def test_residuals_are_grouped_by_unit(self, rig, run):
        scene = Scene(rig)
        frames = feed(scene, run, 20)
        assert scene.residual_names["m"] == ("proximity_x", "proximity_y")
        assert scene.residual_names["N"] == ("force_top", "force_bottom", "force_left", "force_right")
        assert np.abs(joined(frames, "residual/m")[1]).max() == pytest.approx(1.0, rel=0.01)  # µm

    def test_orbit_is_the_last_two_revolutions_with_the_keyphasor_on_it(self, rig, run):
        frame = feed(Scene(rig), run, 20)[-1]
        for name, scale in {"measured": 1.0, "twin": 1.01}.items():
            orbit = frame.orbits[name]
            assert np.hypot(*orbit.path.T) == pytest.approx(scale * 1500.0, rel=0.01)
            angle = np.unwrap(np.arctan2(orbit.path[:, 1], orbit.path[:, 0]))
            assert (angle[-1] - angle[0]) / (2 * np.pi) == pytest.approx(2.0, abs=0.05)
            assert np.arctan2(*orbit.marks.T[::-1]) == pytest.approx(-0.7, abs=0.05)
            assert len(orbit.marks) in (1, 2, 3)

    def test_contact_force_points_from_the_wall_to_the_centre(self, rig, run):
        contact = feed(Scene(rig), run, 20)[-2].contact
        assert np.hypot(*contact.force) == pytest.approx(60.0, rel=1e-3)
        direction = contact.position / np.hypot(*contact.position)
        assert contact.force @ direction == pytest.approx(-60.0, rel=1e-3)

    def test_bands_lie_one_standard_deviation_about_the_twin(self, rig, run):
        frames = feed(Scene(rig), run, 20)
        middle = joined(frames, "displacement/twin")[1]
        around = joined(frames, "displacement/band")[1]
        place = MICRO * np.array(SIGMA)
        assert around[:, :2] == pytest.approx(middle - place, abs=1e-3)
        assert around[:, 2:] == pytest.approx(middle + place, abs=1e-3)
        force = joined(frames, "force/twin")[1]
        band = np.array([1.0 - FORCE_SIGMA, 1.0 + FORCE_SIGMA])
        assert joined(frames, "force/band")[1] == pytest.approx(force * band, rel=1e-5)
        assert frames[-1].doubt.sigma == pytest.approx(place)
        assert frames[-1].doubt.position == pytest.approx(frames[-1].orbits["twin"].path[-1], abs=20.0)

    def test_gap_breaks_the_lines_and_is_counted(self, rig, run):
        scene = Scene(rig)
        blocks = [(key, series) for key, series in run if key.endswith("block")]
        kept = blocks[:100] + blocks[130:]
        times, values = joined(feed(scene, kept, 10), "displacement/measured")
        assert scene.skipped == 30 * 250
        assert np.isnan(values).any(axis=1).sum() == 1
        assert np.all(np.diff(times) > 0)

    def test_what_goes_back_in_time_is_left_out(self, rig, run):
        scene = Scene(rig)
        frames = feed(scene, [*run[:40], *run[:40], *run[40:80]], 10)
        assert np.all(np.diff(joined(frames, "displacement/measured")[0]) > 0)
        assert np.all(np.diff(joined(frames, "displacement/twin")[0]) > 0)
        assert scene.skipped == 0

    def test_without_a_twin_shows_the_measurement_only(self, rig, run):
        frame = feed(Scene(rig), [item for item in run if item[0].endswith("block")], 20)[-1]
        assert set(frame.orbits) == {"measured"}
        assert frame.contact is None

    def test_estimates_without_displacement_show_their_residuals(self, rig, run):
        scene = Scene(rig)
        estimate = next(series for key, series in run if key.endswith("estimate"))
        foreign = estimate._replace(
            names=tuple(name.replace("displacement", "other") for name in estimate.names)
        )
        scene.add_estimate(foreign)
        assert set(scene.frame().curves) == {"residual/m", "residual/N"}

    def test_says_nothing_before_the_first_block(self, rig):
        frame = Scene(rig).frame()
        assert frame.curves == {}
        assert frame.orbits == {}
