"""The picture of a rig in the rerun viewer. This is the only file that imports rerun.

A `Screen` draws one run into one recording of the viewer: frames, events and the headline go into a server in
this process, on loopback and with bounded memory, or into a file. Whoever looks connects to that server;
a viewer that is stopped or killed takes nothing from whoever draws. Several screens on one canvas draw
several runs, each with a look of its own, into one picture.
"""

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Literal

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from analysis.regime import Regime
from daq.rig import Rig
from simulator.clearance import bearing_edge
from twin.display_data import MICRO, Contact, Curve, Doubt, Frame, Orbit, Scene
from twin.display_geometry import ruler, view_radius
from twin.display_look import BACKGROUND, RESIDUALS, RULER, RUN, Colour, Look
from twin.viewer import HOST, refuse_taken, wait_until_served

SERVER_MEMORY = "256MB"  # kept for viewers that come late: about twenty minutes of a run
TIMELINE = "time"  # s since the run's start: sample index over rate
WINDOW = 10.0  # s that the plots show while a run is followed
ELLIPSE_POINTS = 33
ARROW = 4.0  # µm of arrow for one newton of contact force

LEVELS = (rr.TextLogLevel.INFO, rr.TextLogLevel.WARN, rr.TextLogLevel.ERROR)

REGIMES = {
    Regime.UNKNOWN: (90, 95, 105),
    Regime.AT_REST: (120, 130, 145),
    Regime.FREE_DECAY: (110, 170, 190),
    Regime.CONTACT_FREE: (60, 170, 120),
    Regime.BOUNCING: (235, 190, 70),
    Regime.ONE_PLACE: (240, 215, 120),
    Regime.TWO_PLACES: (235, 205, 95),
    Regime.THREE_PLACES: (225, 195, 60),
    Regime.MANY_PLACES: (215, 175, 40),
    Regime.DIAGONAL: (160, 200, 80),
    Regime.CHAOTIC: (240, 110, 120),
    Regime.PERMANENT: (230, 130, 60),
    Regime.FORWARD_WHIRL: (190, 90, 200),
    Regime.BACKWARD_WHIRL: (220, 60, 50),
}
WIDTHS = {"twin": 1.0, "band": 0.6}  # of lines on the screen, by what they tell; others are wider
PLOTS = {  # title and share of the height
    "displacement": ("Displacement at the bearing, µm", 3.0),
    "force": ("Force, N", 3.0),
    "speed": ("Speed, Hz", 2.0),
    "residual/m": ("Residual of the probes (measured less twin), µm", 2.0),
    "residual/N": ("Residual of the transducers (measured less twin), N", 2.4),
}


def canvas(identity: str) -> rr.RecordingStream:
    """Return what screens draw on: a recording of the viewer; equal identities are the same recording."""
    stream = rr.RecordingStream("rigtwin", recording_id=identity)
    stream.set_log_tick_enabled(False)
    stream.set_log_time_enabled(False)
    return stream


class Screen:
    """One run as rerun shows it.

    Args:
        rig: what is shown.
        scene: from which the frames come; it knows the names of the twin's residuals.
        canvas: to draw on.
        look: of the run; another than `RUN` draws it into the picture of the run that has the canvas.
    """

    def __init__(self, rig: Rig, scene: Scene, canvas: rr.RecordingStream, look: Look = RUN) -> None:
        self._rig = rig
        self._scene = scene
        self._stream = canvas
        self._look = look
        self._named: set[str] = set()

    def serve(self, port: int) -> str:
        """Serve viewers on loopback; return the address for them. Raises `ViewerError`."""
        refuse_taken(port)
        sink = rr.GrpcServerSink(HOST, port, server_memory_limit=SERVER_MEMORY)
        self._stream.set_sinks(sink, default_blueprint=blueprint(self._rig, following=True))
        wait_until_served(port)
        self.draw_surroundings()
        return str(sink.uri)

    def join(self, address: str) -> None:
        """Show this run too on the server of another screen, which stays open as long as this one."""
        self._stream.connect_grpc(address, default_blueprint=blueprint(self._rig, following=True))
        self.draw_surroundings()

    def save(self, path: Path, others: Sequence[Look] = ()) -> None:
        """Write to a file instead, for a viewer that opens it later at its beginning.

        Args:
            path: of the file.
            others: looks of the runs that will be drawn into the picture too.
        """
        self._stream.save(path, default_blueprint=blueprint(self._rig, following=False, others=others))
        self.draw_surroundings()

    def name(self, text: str) -> None:
        """Give the recording the name that the viewer lists."""
        self._stream.send_recording_name(text)

    def close(self) -> None:
        """Send what is left and end the server or the file."""
        self._stream.flush()
        self._stream.disconnect()

    def show(self, frame: Frame) -> None:
        """Draw a frame."""
        for name, curve in frame.curves.items():
            self._draw_curve(name, curve)
        self._stream.set_time(TIMELINE, duration=frame.time)
        for name, orbit in frame.orbits.items():
            self._draw_orbit(name, orbit)
        if "twin" in frame.orbits:
            self._draw_contact(frame.contact)
        if frame.doubt is not None and "twin" in self._look.orbits:
            self._draw_doubt(frame.doubt)

    def headline(self, time: float, text: str) -> None:
        """Show a line of Markdown above the views."""
        self._stream.set_time(TIMELINE, duration=time)
        self._stream.log(self._look.path("headline"), rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN))

    def regime(self, time: float, regime: str) -> None:
        """Show what the rotor does from now on."""
        self._stream.set_time(TIMELINE, duration=time)
        self._stream.log(self._look.path("regime"), rr.StateChange(state=regime))

    def event(self, time: float, source: str, severity: int, text: str) -> None:
        """Add a line to the event log."""
        self._stream.set_time(TIMELINE, duration=time)
        line = rr.TextLog(f"{time:8.2f} s   {self._look.named(text)}", level=LEVELS[min(severity, 2)])
        self._stream.log(self._look.path("events", source), line)

    def draw_surroundings(self) -> None:
        """Draw what does not move: the bearing's edge and, once, the axes."""
        if self._look is RUN:
            self._draw_axes(MICRO * view_radius(self._rig))
        self._stream.log(
            self._look.path("regime"),
            rr.StateConfiguration(values=list(REGIMES), labels=list(REGIMES), colors=list(REGIMES.values())),
            static=True,
        )
        if self._rig.model is not None:
            strips = [flipped(MICRO * strip) for strip in bearing_edge(self._rig.model)]
            edge = rr.LineStrips2D(
                strips,
                colors=self._look.edge,
                radii=rr.Radius.ui_points(1.5),
                draw_order=10.0 if self._look is RUN else 5.0,
            )
            self._stream.log(self._look.path("orbit", "bearing"), edge, static=True)

    def _draw_axes(self, reach: float) -> None:
        """Draw the axes through the bearing's centre with their marks in µm."""
        marks = ruler(reach)
        zeros = np.zeros_like(marks)
        cross = [np.array([[-reach, 0.0], [reach, 0.0]]), np.array([[0.0, -reach], [0.0, reach]])]
        lines = rr.LineStrips2D(cross, colors=RULER, radii=rr.Radius.ui_points(0.5), draw_order=0.0)
        self._stream.log("orbit/axes", lines, static=True)
        for axis, positions in {"x": (marks, zeros), "y": (zeros, marks)}.items():
            points = rr.Points2D(
                flipped(np.column_stack(positions)),
                labels=[f"{mark:+g}" for mark in marks],
                show_labels=True,
                colors=RULER,
                radii=rr.Radius.ui_points(1.5),
            )
            self._stream.log(f"orbit/axes/{axis}", points, static=True)

    def _draw_curve(self, name: str, curve: Curve) -> None:
        names, colours = self._lines(name, curve.values.shape[1])
        if not names:
            return
        view, _, rest = name.partition("/")
        path = self._look.path(f"plots/{view}", rest)
        if name not in self._named:
            self._named.add(name)
            width = WIDTHS.get(name.rpartition("/")[2], 1.6)
            style = rr.SeriesLines(
                names=names,
                colors=colours,
                widths=[width] * len(names),
                aggregation_policy=rr.components.AggregationPolicy.MinMax,  # a peak shows at any zoom
            )
            self._stream.log(path, style, static=True)
        times = rr.TimeColumn(TIMELINE, duration=curve.times)
        self._stream.send_columns(path, [times], rr.Scalars.columns(scalars=curve.values))

    def _lines(self, name: str, count: int) -> tuple[Sequence[str], Sequence[Colour]]:
        """Return names and colours of a plot's lines, none where this look leaves the plot out.

        The first ones are left out where there are fewer.
        """
        if name in self._look.lines:
            names, colours = self._look.lines[name]
            return [self._look.named(each) for each in names[-count:]], colours[-count:]
        if self._look is not RUN:
            return (), ()
        residuals = self._scene.residual_names[name.removeprefix("residual/")]
        return residuals, [RESIDUALS[number % len(RESIDUALS)] for number in range(count)]

    def _draw_orbit(self, name: str, orbit: Orbit) -> None:
        """Draw the path, a large dot for each passing of the encoder's zero, a small one for now."""
        if name not in self._look.orbits:
            return
        colour, width, size, order = self._look.orbits[name]
        strips, colours = faded(flipped(orbit.path), colour)
        path = rr.LineStrips2D(strips, colors=colours, radii=rr.Radius.ui_points(width), draw_order=order)
        self._stream.log(self._look.path("orbit", name), path)
        dots = flipped(np.vstack((orbit.marks, orbit.path[-1:])))
        sizes = rr.Radius.ui_points([size] * len(orbit.marks) + [0.5 * size])
        points = rr.Points2D(dots, radii=sizes, colors=colour, draw_order=order + 1.0)
        self._stream.log(self._look.path("orbit", f"{name}/keyphasor"), points)

    def _draw_doubt(self, doubt: Doubt) -> None:
        """Draw the ellipse of one standard deviation about the twin's newest position."""
        colour, width, _, order = self._look.orbits["twin"]
        turn = np.linspace(0.0, 2.0 * np.pi, ELLIPSE_POINTS)
        ellipse = doubt.position + doubt.sigma * np.column_stack((np.cos(turn), np.sin(turn)))
        radius = rr.Radius.ui_points(width)
        line = rr.LineStrips2D([flipped(ellipse)], colors=colour, radii=radius, draw_order=order + 1.0)
        self._stream.log(self._look.path("orbit", "twin/band"), line)

    def _draw_contact(self, contact: Contact | None) -> None:
        origins = np.empty((0, 2)) if contact is None else flipped(contact.position[np.newaxis])
        vectors = np.empty((0, 2)) if contact is None else flipped(ARROW * contact.force[np.newaxis])
        arrow = rr.Arrows2D(
            origins=origins,
            vectors=vectors,
            colors=self._look.contact,
            radii=rr.Radius.ui_points(1.5),
            draw_order=50.0,
        )
        self._stream.log(self._look.path("orbit", "contact_force"), arrow)


def flipped(points: NDArray[np.float64]) -> NDArray[np.float32]:
    """Turn y up: the viewer's 2D views have y down."""
    return (points * (1.0, -1.0)).astype(np.float32)


def faded(
    path: NDArray[np.float32], colour: Colour, pieces: int = 4
) -> tuple[list[NDArray[np.float32]], list[Colour]]:
    """Cut a path into pieces that share their ends; the older a piece, the nearer the background's colour."""
    cuts = np.linspace(0, len(path) - 1, pieces + 1).astype(int)
    strips = [path[start : end + 1] for start, end in pairwise(cuts)]
    shares = np.linspace(0.35, 1.0, pieces)
    dark, light = np.array(BACKGROUND), np.array(colour)
    return strips, [tuple((dark + share * (light - dark)).astype(int)) for share in shares]


def blueprint(rig: Rig, *, following: bool, others: Sequence[Look] = ()) -> rrb.Blueprint:
    """Return the arrangement of the views; `following` keeps to the newest data with a sliding window.

    Each of the other looks that are drawn into the picture gets a headline of its own.
    """
    modelled = rig.twin.model != "none"
    left: list[tuple[rrb.View, float]] = [(orbit_view(rig), 7.0)]
    if modelled:
        left.append((regime_view(following), 1.6 + 1.2 * len(others)))
    left.append((event_view(), 2.4))
    state: Literal["following", "playing"] = "following" if following else "playing"
    return rrb.Blueprint(
        rrb.Vertical(
            *(headline_view(look) for look in (RUN, *others)),
            rrb.Horizontal(
                rrb.Vertical(*(view for view, _ in left), row_shares=[share for _, share in left]),
                plot_views(modelled, following),
                column_shares=[4, 5],
            ),
            row_shares=[*[1] * (1 + len(others)), 12.5],
        ),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state=state),
    )


def headline_view(look: Look) -> rrb.TextDocumentView:
    """Return the view of one run's headline."""
    return rrb.TextDocumentView(
        origin=look.path("headline"), contents="$origin", name=look.label or "Rig", titlebar=False
    )


def orbit_view(rig: Rig) -> rrb.Spatial2DView:
    """Return the view of the shaft's centre, with equal scales."""
    reach = MICRO * view_radius(rig)
    return rrb.Spatial2DView(
        origin="orbit",
        name="Orbit at the bearing, µm (seen from the free end, y up)",
        background=BACKGROUND,
        visual_bounds=rrb.VisualBounds2D(x_range=(-reach, reach), y_range=(-reach, reach)),
    )


def event_view() -> rrb.TextLogView:
    """Return the view of the event log."""
    return rrb.TextLogView(
        origin="events",
        name="Events",
        columns=rrb.TextLogColumns(text_log_columns=["loglevel", "body"]),
    )


def regime_view(following: bool) -> rrb.StateTimelineView:
    """Return the view of what the rotor does over time."""
    return rrb.StateTimelineView(origin="regime", name="Regime", time_ranges=window(following))


def plot_views(modelled: bool, following: bool) -> rrb.Vertical:
    """Return the plots over time; a rig without a model has no residuals."""
    views = [(path, name, share) for path, (name, share) in PLOTS.items()]
    shown = [view for view in views if modelled or not view[0].startswith("residual")]
    plots = [plot_view(f"plots/{path}", name, following) for path, name, _ in shown]
    return rrb.Vertical(*plots, row_shares=[share for _, _, share in shown])


def plot_view(origin: str, name: str, following: bool) -> rrb.TimeSeriesView:
    """Return the view of one plot."""
    return rrb.TimeSeriesView(
        origin=origin,
        name=name,
        plot_legend=rrb.Corner2D.LeftTop,
        time_ranges=window(following),
        axis_x=rrb.TimeAxis(link="LinkToGlobal"),
    )


def window(following: bool) -> list[rrb.VisibleTimeRange]:
    """Return the stretch of time to show: the last seconds, or everything."""
    if not following:
        return [
            rrb.VisibleTimeRange(
                TIMELINE, start=rrb.TimeRangeBoundary.infinite(), end=rrb.TimeRangeBoundary.infinite()
            )
        ]
    start = rrb.TimeRangeBoundary.cursor_relative(seconds=-WINDOW)
    return [rrb.VisibleTimeRange(TIMELINE, start=start, end=rrb.TimeRangeBoundary.cursor_relative())]
