"""What the formation is flown through: sea, sound, sensors and navigators."""

from dataclasses import dataclass

from experiments.flight.library import load
from sim.scenario.settings import Scenario

ASIDE = {6: 4.0, 7: -5.0, 8: 6.0, 9: -7.0}
"""To port of the axis, where the followers astern stand in conditions that keep them off it [m]."""
_GOLDEN_DEG = 137.508
"""Directions of the current from run to run: spread evenly, however many runs there are."""
_PAIR_DEG = (271.756, 205.1425)
"""Phases of log and compass from run to run, spread evenly as pairs: 360° by the plastic number and by its square."""


@dataclass(frozen=True, kw_only=True)
class Condition:
    """What differs from the built-in swarm."""

    name: str
    title: str
    settings: tuple[str, ...] = ()
    """Assignments `key=value` of the scenario."""
    current: float = 0.0
    """Greatest speed of a current from any direction, which every run has another share of [m/s]."""
    aside: bool = False
    """No station is within 3 m of the leader's axis."""
    drift: bool = False
    """The place that the leader broadcasts walks off by 1 cm/s, in another direction in every run."""
    set_back: float = 0.0
    """So much farther behind than in the built-in swarm is every station [m]."""
    count: int = 0
    """So many followers in a grid, in place of the built-in ten; 0: those."""
    layers: int = 1
    """Layers of that grid, a metre apart."""
    swing: bool = False
    """The biases of log and compass begin their swings at other phases in every run."""
    share: int = 1
    """One of so many runs is flown."""
    truth: bool = False
    """Followers steer by the truth."""

    def scenario(self, run: int, duration_s: float = 1000.0) -> Scenario:
        """The mission of one run."""
        told = [*self.settings, f"run={run}", f"duration_s={duration_s}"]
        if self.current:
            speed = self.current * (1 + run % 5) / 5
            told += [f"ocean.current_speed_m_s={speed}", f"ocean.current_direction_deg={run * _GOLDEN_DEG % 360}"]
        if self.aside:
            told += [f"followers.{i}.station.port_m={port}" for i, port in ASIDE.items()]
        if self.drift:
            astray = run * _GOLDEN_DEG % 360
            told += ["sensors.leader_position_drift_m_s=0.01", f"sensors.leader_position_drift_deg={astray}"]
        if self.swing:
            phases = [run * step % 360 for step in _PAIR_DEG]
            told += [f"sensors.speed_drift_phase_deg={phases[0]}", f"sensors.heading_drift_phase_deg={phases[1]}"]
        if self.set_back:
            ten = load("swarm", ()).followers
            behind = [f.station.behind_m + self.set_back for f in ten if f.station]
            told += [f"followers.{i}.station.behind_m={metres}" for i, metres in enumerate(behind)]
        if self.count:
            depths = f"layer_m = 1.0, layers = {self.layers}"
            shape = f'{{ kind = "grid", count = {self.count}, spacing_m = 10.0, {depths} }}'
            told += ["followers=[]", f"formation.shape={shape}"]
        if self.truth:
            told += [f"followers.{i}.steers_by=truth" for i in range(10)]
        return load("swarm", told)


_TWO = ("navigation.assume.transmitters=2",)
_SLOW = ("timing.message_interval_s=5",)
_ACROSS = ("ocean.current_speed_m_s=0.5", "ocean.current_direction_deg=0")
_ALONG = ("ocean.current_speed_m_s=0.5", "ocean.current_direction_deg=90")
_LOSS = ("acoustics.loss_chance=0.2",)
_NEAR = ("formation.proximity.range_m=8",)
_COMPASS = ("sensors.leader_heading_bias_deg=5", "navigation.assume.exact_leader=false")
_BURSTS = ("acoustics.burst_chance=0.1333", "acoustics.burst_mean_messages=5")
_LONG_BURSTS = ("acoustics.burst_chance=0.01111", "acoustics.burst_mean_messages=60")
_PLANNED = ("leader.broadcast_waypoints=2",)
_STRAIGHT = ("leader.waypoints=[[0, 0, 0], [1000, 1000, 0]]",)

CONDITIONS = (
    Condition(name="calm", title="calm"),
    Condition(name="truth", title="calm, steering by the truth", truth=True),
    Condition(name="current", title="current up to 0.5 m/s, any direction", current=0.5),
    Condition(name="along", title="current 0.5 m/s along the first leg", settings=_ALONG),
    Condition(name="shear", title="current 0.5 m/s, 0.02 m/s less for each metre of depth",
              settings=(*_ACROSS, "ocean.current_shear_per_s=0.02")),
    Condition(name="waves", title="waves, Hs 0.5 m",
              settings=("ocean.waves.kind=jonswap", "ocean.waves.height_m=0.5")),
    Condition(name="high waves", title="waves, Hs 1 m",
              settings=("ocean.waves.kind=jonswap", "ocean.waves.height_m=1")),
    Condition(name="dive", title="leader dives from 5 to 40 m in 150 s",
              settings=("leader.depth_profile=[[0, 5], [200, 5], [350, 40]]", "ocean.floor_depth_m=60")),
    Condition(name="loss", title="20 % of messages lost", settings=_LOSS),
    Condition(name="bursts", title="40 % of messages lost, in bursts", settings=_BURSTS),
    Condition(name="long bursts", title="40 % of messages lost, in bursts of 60 s",
              settings=_LONG_BURSTS),
    Condition(name="long bursts straight",
              title="40 % of messages lost, in bursts of 60 s, behind a leader that goes straight on",
              settings=(*_LONG_BURSTS, *_STRAIGHT)),
    Condition(name="long bursts truth", title="40 % of messages lost, in bursts of 60 s, steering by the truth",
              settings=_LONG_BURSTS, truth=True),
    Condition(name="long bursts plan",
              title="40 % of messages lost, in bursts of 60 s, messages carry the leader's next two waypoints",
              settings=(*_LONG_BURSTS, *_PLANNED)),
    Condition(name="long bursts plan truth",
              title="40 % of messages lost, in bursts of 60 s, next two waypoints, steering by the truth",
              settings=(*_LONG_BURSTS, *_PLANNED), truth=True),
    Condition(name="echoes", title="5 % echoes",
              settings=("acoustics.surface_echo_chance=0.025", "acoustics.bottom_echo_chance=0.025")),
    Condition(name="compass", title="leader's compass 5° off, and estimated, in water known to be still",
              settings=(*_COMPASS, "navigation.assume.current=false")),
    Condition(name="compass beside", title="leader's compass 5° off, and estimated beside a current",
              settings=_COMPASS),
    Condition(name="drift", title="biases of log and compass that drift by 0.1 m/s and 3°, and estimated",
              settings=("sensors.speed_drift_m_s=0.1", "sensors.heading_drift_deg=3", "navigation.assume.drift=true"),
              swing=True),
    Condition(name="ins", title="leader's own place walks off by 1 cm/s", drift=True),
    Condition(name="5 s", title="messages every 5 s", settings=_SLOW),
    Condition(name="5 s current", title="messages every 5 s, current up to 0.5 m/s", settings=_SLOW, current=0.5),
    Condition(name="5 s loss", title="messages every 5 s, 20 % lost", settings=(*_SLOW, *_LOSS)),
    Condition(name="5 s loss back", title="messages every 5 s, 20 % lost, stations 20 m and more behind",
              settings=(*_SLOW, *_LOSS), set_back=15.0),
    Condition(name="10 s", title="messages every 10 s", settings=("timing.message_interval_s=10",)),
    Condition(name="two aside", title="2 transmitters, no station near the axis", settings=_TWO, aside=True),
    Condition(name="two", title="2 transmitters", settings=_TWO),
    Condition(name="two across", title="2 transmitters, current 0.5 m/s across", settings=(*_TWO, *_ACROSS)),
    Condition(name="fifty", title="50 followers in a grid of four layers", count=50, layers=4, share=5),
    Condition(name="fifty near", title="50 followers in a grid, in one layer, that sense each other", settings=_NEAR,
              count=50, share=5),
    Condition(name="laisn-2", title="LAISN-2", settings=("navigation.variant=laisn-2",)),
    Condition(name="laisn-3-1", title="LAISN-3(1)", settings=("navigation.variant=laisn-3-1",)),
    Condition(name="laisn-3-2", title="LAISN-3(2)", settings=("navigation.variant=laisn-3-2",)),
    Condition(name="ilos", title="law ilos, current up to 0.5 m/s", settings=("formation.law=ilos",), current=0.5),
    Condition(name="alos", title="law alos, current up to 0.5 m/s", settings=("formation.law=alos",), current=0.5),
)  # fmt: skip
"""Where a title does not say otherwise: the tightly coupled navigator, 3 transmitters, messages every second."""
