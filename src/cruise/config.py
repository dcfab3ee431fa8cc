"""What a race and a training run are made of, as plain frozen data. Knows nothing of JAX."""

from dataclasses import asdict, dataclass, field
from typing import Literal

Vec3 = tuple[float, float, float]
Integrator = Literal["euler", "semi_implicit", "midpoint", "rk4"]
Control = Literal["acceleration", "velocity", "position", "ctbr"]
ObservationKind = str  # name of an observation: one of `cruise.env.observation`, or one that its user declared
GateShape = Literal["rectangle", "round"]
SelfPlayMode = Literal["within", "after", "off"]
OUR_SIMULATOR = "cruise"  # what moves the drones where no other is named


@dataclass(frozen=True)
class CascadeGains:
    """Gains of the paper's cascaded controller (Sec. 3.1.2), equal on every axis."""

    velocity_p: float = 0.42  # K_v [1/s]
    velocity_d: float = 2.0  # K_vd, on e_t - e_{t-1}, not divided by dt [1/s]
    position_p: float = 5.0  # K_p,pos [-]
    position_d: float = 0.05  # K_d,pos [1/s]
    attitude_p: float = 0.1  # K_p,att [N m/rad]
    attitude_d: float = 0.05  # K_d,att [N m s/rad]


@dataclass(frozen=True)
class Rotors:
    """Four rotors in an X, and what limits them. `docs/vehicles.md` has the equations."""

    offset: tuple[float, float]  # of every rotor from the centre, forward and sideways [m]
    torque_ratio: float  # kappa, reaction torque per thrust [m]
    max_thrust: float  # of one rotor [N]
    min_thrust: float = 0.0  # of one rotor [N]
    time_constant: float = 0.0  # first-order lag of the thrust; 0: none [s]
    radius: float = 0.0635  # of a propeller [m]
    saturate: bool = True  # False: as if rotors had no limits


@dataclass(frozen=True)
class Rates:
    """The body-rate loop of the flight controller."""

    time_constant: float = 0.04  # of the response without rotor lag, on every axis [s]
    highest: Vec3 = (10.0, 10.0, 3.0)  # that can be commanded: roll, pitch, yaw [rad/s]


@dataclass(frozen=True)
class Drag:
    """Drag on the body at an airspeed; 0 switches a term off."""

    horizontal: float = 0.0  # linear, in the plane of the rotors [kg/s]
    vertical: float = 0.0  # linear, along the thrust [kg/s]
    quadratic: float = 0.0  # along the airspeed [kg/m]


@dataclass(frozen=True)
class Battery:
    """A battery with an internal resistance, whose voltage falls with its charge."""

    capacity: float = 6480.0  # [A s]
    full_voltage: float = 16.8  # at rest [V]
    empty_voltage: float = 13.2  # at rest [V]
    resistance: float = 0.02  # [ohm]
    efficiency: float = 0.5  # of motor and propeller: ideal power of hovering rotors per electric power


@dataclass(frozen=True)
class Airframe:
    """What makes a quadrotor fly by collective thrust and body rates."""

    rotors: Rotors
    rates: Rates = field(default_factory=Rates)
    drag: Drag = field(default_factory=Drag)
    delay: float = 0.0  # from an action to its effect; 0: none [s]
    longest_delay: float = 0.0  # that randomisation may ask for [s]
    battery: Battery | None = None  # None: voltage stays where it is
    downwash: bool = False  # the air that rotors push down moves the drones below


@dataclass(frozen=True)
class Tracking:
    """The position and velocity loops around every vehicle, and full deflection of a reference."""

    position_gain: float = 2.0  # [1/s]
    velocity_gain: float = 4.0  # [1/s]
    attitude_gain: float = 12.0  # [1/s]
    speed: float = 5.0  # a velocity reference at full deflection [m/s]
    reach: float = 2.0  # a position reference at full deflection: so far from the drone [m]


@dataclass(frozen=True)
class Vehicle:
    """A quadrotor and the loop that flies it.

    The controller reads one action every `control_dt` and the body is integrated in `substeps` equal steps. Without an
    airframe it is the paper's: a cascade of PD laws whose wrench acts on the body as it is, held over the whole step.
    """

    name: str = "paper"
    mass: float = 1.0  # [kg]
    inertia: Vec3 = (0.005, 0.005, 0.009)  # principal moments [kg m^2]
    gravity: float = 9.81  # [m/s^2]
    controller: CascadeGains = field(default_factory=CascadeGains)
    control_dt: float = 0.1  # [s]
    integrator: Integrator = "euler"
    substeps: int = 1
    collision_distance: float = 0.25  # two drones nearer than this have collided [m]
    source: str = "CRUISE paper and its repository"
    control: Control = "acceleration"  # what an action means
    agility: float = 7.5  # usual scale of the action, alpha: the largest commanded acceleration or thrust [m/s^2]
    collision_aspect: float = 1.0  # height per width of the ellipsoid in which two drones collide; 1: a sphere
    flip_ends: bool = True  # rolling or pitching past 90 degrees is a crash
    tracking: Tracking = field(default_factory=Tracking)
    airframe: Airframe | None = None


@dataclass(frozen=True)
class Gate:
    """An opening that is crossed along its normal, the first of its axes (forward, left, up).

    The axes are the columns of Rz(yaw) Ry(pitch) Rx(roll); the normal of an upright gate is `(cos yaw, sin yaw, 0)`.
    """

    position_w: Vec3  # centre of the opening [m]
    yaw: float  # heading of the normal, the direction of flight [rad]
    width: float = 2.0  # of the opening; the diameter of a round one [m]
    height: float = 2.0  # of the opening; the width of a round one [m]
    roll: float = 0.0  # about the normal [rad]
    pitch: float = 0.0  # of the normal below the horizon [rad]
    shape: GateShape = "rectangle"


@dataclass(frozen=True)
class Pole:
    """A vertical cylinder, solid."""

    base_w: Vec3  # middle of its foot [m]
    height: float  # [m]
    radius: float  # [m]


@dataclass(frozen=True)
class Wall:
    """An upright box, solid."""

    position_w: Vec3  # its centre [m]
    size: Vec3  # length along its heading, thickness, height [m]
    yaw: float = 0.0  # heading of its length [rad]


Obstacle = Pole | Wall


@dataclass(frozen=True)
class Track:
    """Gates in the order they are flown, repeated every lap, and what else stands there."""

    name: str
    gates: tuple[Gate, ...]
    bounds_low: Vec3  # lowest corner of the box a drone may fly in [m]
    bounds_high: Vec3  # highest corner [m]
    laps: int = 3
    frame_width: float = 0.3  # solid border around every opening [m]
    leave_distance: float = 10.0  # farther than this from every gate has left the track [m]
    variants: tuple[tuple[Gate, ...], ...] = ()  # other places of the same gates; where given, every race draws one
    obstacles: tuple[Obstacle, ...] = ()


@dataclass(frozen=True)
class Stage:
    """Theta_k, one row of the paper's curriculum table."""

    name: str
    steps: int  # N_k, environment steps of the active drone
    v_min: float  # reference speed [m/s]
    agility: float  # alpha, scale of the action [m/s^2]
    collision_penalty: bool  # c_enable
    w_coll: float
    gate_tolerance: float  # margin around the opening in which a crossing still counts [m]
    w_over: float
    terminal_collisions: bool
    crash_share: float = 1.0  # of the price of a crash that ends an episode, `RewardWeights.terminal`


@dataclass(frozen=True)
class RewardWeights:
    """Weights of the reward's components that do not change with the stage.

    The first eight are the paper's; the others are zero there. `docs/reward.md` justifies the default.
    """

    w_prox: float = 0.0
    proximity_decay: float = 2.0  # a
    proximity_range: float = 10.0  # x = distance / range [m]
    w_prog: float = 0.45
    progress_scale: float = 2.5  # beta [1/m]
    progress_to: Literal["opening", "centre"] = "opening"  # where the distance of prox and prog ends
    pay_up_to_v_min: bool = False  # progress faster than the stage's v_min earns no more than at v_min
    w_align: float = 0.02
    w_speed: float = 0.05
    speed_zero_at: Literal["rest", "v_min"] = "rest"  # at this speed its component is zero, at v_min the highest
    overtake_sign: Literal["fixed", "paper"] = "fixed"
    overtake_range: float = 3.0  # overtaking counts against opponents nearer than this [m]
    gate_bonus: float = 10.0  # reward of the step that passes a gate, in place of the terms of flight
    w_edge: float = 40.0  # per metre that a crossing lies outside the opening shrunk by `edge_margin`
    edge_margin: float = 0.2  # [m]
    w_near: float = 0.5  # per metre that the nearest opponent is closer than `near_distance`
    near_distance: float = 1.2  # [m]
    clip: float = 1.0  # each step's sum is clipped to [-clip, clip], a gate's bonus to what it is
    terminal: float = -10.0  # reward of the step that ends an episode, outside the clip


@dataclass(frozen=True)
class PPOConfig:
    """Proximal policy optimisation."""

    races: int = 512  # E, simulated in parallel
    rollout_steps: int = 64  # T, per update
    epochs: int = 4
    minibatches: int = 16
    learning_rate: float = 1e-3
    final_learning_rate: float = 1e-4  # reached linearly at the end of the run
    gamma: float = 0.99
    gae_lambda: float = 0.98
    after_crash: Literal["restart", "nothing"] = "restart"  # the future that a crash leaves to the value function
    clip_ratio: float = 0.2
    value_weight: float = 0.5
    entropy_weight: float = 0.005  # of the entropy bonus, until `entropy_hold`
    entropy_hold: float = 0.0  # share of the run after which the bonus falls, linearly
    entropy_end: float = 1.0  # share of the run after which there is none
    max_grad_norm: float = 0.5
    hidden: tuple[int, ...] = (64, 64)
    initial_log_std: float = -0.5
    max_log_std: float = 0.0  # of the policy's Gaussian; the environment clips actions to [-1, 1]
    caution_distance: float = 5.0  # an opponent nearer than this narrows the noise in proportion; 0: none does [m]
    least_noise: float = 0.1  # share of the noise that caution leaves
    company_distance: float = 0.0  # advantages with an opponent nearer than this stand apart; 0: none do [m]


@dataclass(frozen=True)
class SelfPlayConfig:
    """Iterative self-play (Algorithm 1)."""

    self_play: SelfPlayMode = "within"  # every stage, after the curriculum flown alone, or never
    evaluate_every: int = 500_000  # T_eval, environment steps
    win_threshold: float = 0.6  # tau
    patience: int = 2  # evaluations short of tau after which opponents are replaced all the same; 0: never
    sparring_share: float = 0.1  # of the opponents in training that chase gates by hand, at many speeds; 0: none
    league: int = 0  # places for past policies, which fly the opponents of half the races; 0: the newest fly all
    founders: tuple[str, ...] = ()  # names or paths of policies that hold a place in the league from the start
    vary_field: bool = False  # a race in training has 1 to N drones, each number as often
    evaluation_races: int = 100  # n_eval
    evaluation_steps: int = 300  # length of an evaluation episode, in control steps


@dataclass(frozen=True)
class Randomisation:
    """How far a race may be from what vehicle and track say, drawn anew for every race; 0 changes nothing.

    A spread is the largest relative deviation, drawn evenly from both sides. An error is the standard deviation of what
    a sensor is wrong by for a whole race; half as much white noise comes on top of it at every control step.
    """

    mass_spread: float = 0.0
    inertia_spread: float = 0.0
    thrust_spread: float = 0.0  # of what the rotors give
    drag_spread: float = 0.0
    lag_spread: float = 0.0  # of the time constants of rotors and of the rate loop
    clip_share: float = 0.0  # most of a demand's cut to the rotors' limits that is made rotor by rotor, not by priority
    extra_delay: float = 0.0  # longest, beyond the vehicle's own, from an action to its effect [s]
    wind_speed: float = 0.0  # strongest, steady and level, from anywhere [m/s]
    gust_speed: float = 0.0  # root mean square along every axis [m/s]
    gate_shift: float = 0.0  # farthest along every axis [m]
    gate_turn: float = 0.0  # largest, about the vertical [rad]
    position_error: float = 0.0  # along every axis [m]
    velocity_error: float = 0.0  # along every axis [m/s]
    attitude_error: float = 0.0  # about every axis [rad]
    rate_error: float = 0.0  # about every axis [rad/s]

    def scaled(self, factor: float) -> "Randomisation":
        """All of it so many times as strong."""
        return Randomisation(**{name: factor * value for name, value in asdict(self).items()})


@dataclass(frozen=True)
class TrainConfig:
    """Everything a training run depends on."""

    track: str = "ring"  # name of a built-in track, path of a TOML file, or `random`
    drones: int = 4
    seed: int = 0
    vehicle: str = "paper"
    start_from: str = ""  # name or path of a policy that learns on; none: from scratch
    against: str = ""  # name or path of a policy that flies all opponents and never changes; none: self-play
    observation: ObservationKind = "extended"  # what the policy sees; `cruise observations` lists them
    vanilla: bool = False  # train on the last stage alone, from scratch, for as many steps
    step_scale: float = 1.0  # multiplies every stage's budget
    episode_steps: int = 300  # time limit of a training episode, in control steps
    collision_distance: float = 0.4  # two drones nearer than this collide while training [m]
    checkpoint_seconds: float = 30.0
    reward: RewardWeights = field(default_factory=RewardWeights)
    ppo: PPOConfig = field(default_factory=PPOConfig)
    opponents: SelfPlayConfig = field(default_factory=SelfPlayConfig)
    randomisation: Randomisation = field(default_factory=Randomisation)
    milder_share: float = 0.0  # of the races in training that differ by less than that, by any part of it as often
    nominal_share: float = 0.0  # of the races in training that do not differ at all
