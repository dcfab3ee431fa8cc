"""What a race and a training run are made of, as plain frozen data. Knows nothing of JAX."""

import math
from dataclasses import asdict, dataclass, field, fields, replace
from os import PathLike
from typing import Literal

from cruise import actions
from cruise.actions import Action, Control, YawControl

Vec3 = tuple[float, float, float]
Integrator = Literal["euler", "semi_implicit", "midpoint", "rk4"]
FlownBy = Literal["cascade", "rotors"]
OWN_CONTROLS: dict[FlownBy, tuple[Control, ...]] = {"cascade": ("acceleration",), "rotors": ("ctbr", "attitude")}
ObservationKind = str  # name of an observation: one of `cruise.env.observation`, or one that its user declared
GateShape = Literal["rectangle", "round"]
Finish = Literal["first", "last"]
NetworkKind = Literal["mlp", "gru"]
FirmwareSettings = Literal["matched", "stock"]
SelfPlayMode = Literal["within", "after", "off"]
Learners = Literal["one", "all"]
SensingKind = Literal["exact", "range", "camera"]
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
    thrust_curve: float = 0.0  # 0 to 1: how far thrust goes with the square of the command, unknown to the controller


@dataclass(frozen=True)
class Rates:
    """The body-rate loop of the flight controller."""

    time_constant: float = 0.04  # of the response without rotor lag, on every axis [s]
    highest: Vec3 = (10.0, 10.0, 3.0)  # that can be commanded: roll, pitch, yaw [rad/s]
    integral_gain: float = 0.0  # of the integral of the error, per gain of the error; 0: no integral [1/s]


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
class AttitudeLimits:
    """What an attitude loop around the rates may be asked for; its gain is `Tracking.attitude_gain`."""

    highest_tilt: float = 0.9  # roll and pitch that can be commanded, below a quarter turn [rad]
    yaw: YawControl = "rate"  # an action says how fast to yaw, or where to
    highest_yaw: float = math.pi  # that can be commanded where it says where to [rad]


@dataclass(frozen=True)
class Airframe:
    """What makes a quadrotor fly by collective thrust and body rates."""

    rotors: Rotors
    rates: Rates = field(default_factory=Rates)
    attitude: AttitudeLimits = field(default_factory=AttitudeLimits)
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
    """A quadrotor, the loop that flies it and what it is told, its `action`.

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
    control: Control = "acceleration"  # what an action means; see `action`
    agility: float = 7.5  # usual scale of the action, alpha: the largest commanded acceleration or thrust [m/s^2]
    collision_aspect: float = 1.0  # height per width of the ellipsoid in which two drones collide; 1: a sphere
    flip_ends: bool = True  # rolling or pitching past 90 degrees is a crash
    tracking: Tracking = field(default_factory=Tracking)
    airframe: Airframe | None = None
    indoors: bool = False  # full randomisation brings a draught, not a breeze

    @property
    def flown_by(self) -> FlownBy:
        """What carries it: rotors that lag and saturate, or the paper's cascade, whose wrench acts at once."""
        return "cascade" if self.airframe is None else "rotors"

    @property
    def told_directly(self) -> bool:
        """Whether an action is what its own loop takes, and not a reference that is tracked around that loop."""
        return self.control in OWN_CONTROLS[self.flown_by]

    @property
    def own(self) -> "Vehicle":
        """The vehicle by what its own loop takes: itself where it is told directly."""
        return self if self.told_directly else replace(self, control=OWN_CONTROLS[self.flown_by][0])

    @property
    def action(self) -> Action:
        """What it is told at every control step, at its usual agility."""
        tracking, airframe = self.tracking, self.airframe
        if self.control == "velocity":
            return actions.velocity(tracking.speed)
        if self.control == "position":
            return actions.position(tracking.reach)
        if self.control == "acceleration" or airframe is None:
            return actions.acceleration(self.agility)
        rates = airframe.rates.highest
        if self.control == "ctbr":
            return actions.ctbr(self.agility, self.gravity, rates)
        limits = airframe.attitude
        highest_turn = limits.highest_yaw if limits.yaw == "angle" else rates[2]
        return actions.attitude(self.agility, self.gravity, limits.highest_tilt, limits.yaw, highest_turn)

    @property
    def randomisable(self) -> frozenset[str]:
        """Fields of `Randomisation` that mean something for it: gates and sensors for all, body and air with rotors."""
        return AROUND_THE_VEHICLE if self.airframe is None else AROUND_THE_VEHICLE | OF_BODY_AND_AIR


@dataclass(frozen=True)
class Motion:
    """How a gate moves to and fro: each amplitude times sin(2 pi t / period + phase), t seconds into the race."""

    period: float  # [s]
    sway_w: Vec3 = (0.0, 0.0, 0.0)  # amplitude of its centre [m]
    swing: float = 0.0  # amplitude of its yaw [rad]
    phase: float = 0.0  # [rad]


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
    motion: Motion | None = None  # about where it is; None: it stands still

    @property
    def size(self) -> tuple[float, float]:
        """Width and height of the opening, of a round one its diameter twice [m]."""
        return self.width, self.width if self.shape == "round" else self.height


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
class StartPlace:
    """Where one drone waits."""

    position_w: Vec3  # [m]
    yaw: float  # [rad]


@dataclass(frozen=True)
class StartPlaces:
    """Drones wait at the first ones of these places, dealt out by chance."""

    places: tuple[StartPlace, ...]


@dataclass(frozen=True)
class StartLine:
    """Drones wait side by side, however many."""

    middle_w: Vec3  # [m]
    yaw: float  # of all drones; the line lies across it [rad]
    spacing: float  # of neighbours [m]


Start = StartPlaces | StartLine


def gates_to_finish(laps: int, gates: int, finish: str) -> int:
    """Crossings that finish a race of so many laps of so many gates: the first one starts lap 1."""
    return laps * gates + (finish == "first")


@dataclass(frozen=True)
class Track:
    """Gates in the order they are flown, repeated every lap, and what else stands there."""

    name: str
    gates: tuple[Gate, ...]
    bounds_low: Vec3  # lowest corner of the box a drone may fly in [m]
    bounds_high: Vec3  # highest corner [m]
    laps: int = 3
    frame_width: float = 0.3  # solid border around every opening [m]
    frame_depth: float = 0.0  # how thick it is along the flight [m]
    leave_distance: float = 10.0  # farther than this from every gate has left the track [m]
    variants: tuple[tuple[Gate, ...], ...] = ()  # other places of the same gates; where given, every race draws one
    variant_obstacles: tuple[tuple[Obstacle, ...], ...] = ()  # of each of the variants; none: `obstacles` of all
    reshaped: bool = False  # and mirrors, turns round and stretches it, with openings of other sizes
    obstacles: tuple[Obstacle, ...] = ()
    start: Start | None = None  # None: a grid before a gate, by chance
    start_gate: int = 0  # index of the first gate to pass from `start`
    finish: Finish = "first"  # gate of a lap at which a race ends: where it began again, or the lap's last

    @property
    def moves(self) -> bool:
        """Whether any of its gates does."""
        return any(gate.motion for gate in self.gates)

    def gates_to_finish(self, laps: int) -> int:
        """Crossings that finish a race of so many laps: the first one starts lap 1."""
        return gates_to_finish(laps, len(self.gates), self.finish)


@dataclass(frozen=True)
class Stage:
    """Theta_k, one row of the paper's curriculum table."""

    name: str
    steps: int  # N_k, environment steps of all who learn
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

    `--reward-preset paper` has the printed values; `w_edge`, `w_beside` and `w_near`, which it does not have, are 0
    there. `docs/reward.md` has the equations and why the default differs.
    """

    w_prox: float = 0.0  # Weight of the proximity term `prox`.
    proximity_decay: float = 2.0  # Exponent a of the proximity term.
    proximity_range: float = 10.0  # Distances are divided by this in the proximity term [m].
    w_prog: float = 0.45  # Weight of the progress term `prog`.
    progress_scale: float = 2.5  # Progress per metre nearer to the gate, beta [1/m].
    progress_to: Literal["opening", "centre"] = "opening"  # Point of the gate that prox and prog measure to.
    pay_up_to_v_min: bool = False  # No extra reward for progress faster than the stage's v_min.
    w_align: float = 0.02  # Weight of the alignment term `align`.
    w_speed: float = 0.05  # Weight of the speed term `speed`.
    speed_zero_at: Literal["rest", "v_min"] = "rest"  # Speed at which its term is zero; at v_min it is highest.
    overtake_sign: Literal["fixed", "paper"] = "fixed"  # `paper`: as printed, it rewards being overtaken.
    overtake_range: float = 3.0  # Only opponents nearer than this count as overtaken [m].
    gate_bonus: float = 10.0  # Reward of a step that passes a gate; replaces the flight terms.
    w_edge: float = 40.0  # Penalty per metre that a crossing is nearer to the frame than `edge_margin`.
    edge_margin: float = 0.2  # Distance from the frame that costs nothing [m].
    w_beside: float = 0.0  # Penalty per metre that a way past a gate is nearer to its frame than `beside_margin`.
    beside_margin: float = 0.4  # Distance from the outside of a frame that costs nothing [m].
    w_near: float = 0.5  # Penalty per metre that the nearest opponent is closer than `near_distance`.
    near_distance: float = 1.2  # Distance from an opponent that costs nothing [m].
    clip: float = 1.0  # Limit of each step's sum, on both sides; a gate's bonus is limited to its own size.
    terminal: float = -10.0  # Reward of a step that ends in a crash; not clipped.


@dataclass(frozen=True)
class PPOConfig:
    """Hyperparameters of proximal policy optimisation (PPO)."""

    races: int = 512  # Number of parallel environments (races), E.
    rollout_steps: int = 64  # Steps per environment and update, T.
    epochs: int = 4  # Passes over each rollout.
    minibatches: int = 16  # Minibatches per epoch.
    learning_rate: float = 1e-3  # Adam's learning rate at the start.
    final_learning_rate: float = 1e-4  # Learning rate at the end; it falls linearly.
    # KL divergence of an update that the learning rate follows, a quarter of it at the end; 0: the rate falls.
    target_kl: float = 0.0
    # Updates over which parameters are averaged to be measured, raced against and kept; 0: the newest are.
    average_updates: int = 0
    gamma: float = 0.99  # Discount factor per step.
    gae_lambda: float = 0.98  # Lambda of generalised advantage estimation (GAE).
    after_crash: Literal["restart", "nothing"] = "restart"  # Value after a crash: of the restart, or 0.
    clip_ratio: float = 0.2  # Clip range of the probability ratio.
    value_weight: float = 0.5  # Weight of the value loss.
    value_loss: Literal["absolute", "relative"] = "absolute"  # Relative: over the variance of the value targets.
    entropy_weight: float = 0.005  # Weight of the entropy bonus at the start.
    entropy_hold: float = 0.0  # Share of the run after which the entropy bonus begins to fall, linearly.
    entropy_end: float = 1.0  # Share of the run after which the entropy bonus is zero.
    max_grad_norm: float = 0.5  # Gradient clipping: largest global norm.
    network: NetworkKind = "mlp"  # mlp: multilayer perceptrons; gru: recurrent, a policy with memory.
    memory_size: int = 64  # Units of the recurrent state (gru).
    hidden: tuple[int, ...] = (64, 64)  # Units of each hidden layer.
    initial_log_std: float = -0.5  # Log standard deviation of the actions at the start.
    max_log_std: float = 0.0  # Largest log standard deviation; the environment clips actions to [-1, 1].
    final_max_log_std: float = 0.0  # The same at the end of the run; it falls linearly.
    caution_distance: float = 5.0  # Exploration noise shrinks with an opponent nearer than this; 0: never [m].
    least_noise: float = 0.1  # Smallest factor by which an opponent nearby scales the exploration noise.
    company_distance: float = 0.0  # Steps with an opponent nearer get advantages normalised apart; 0: none [m].


@dataclass(frozen=True)
class SelfPlayConfig:
    """Iterative self-play (Algorithm 1)."""

    self_play: SelfPlayMode = "within"  # Self-play in every stage, only after the curriculum, or never.
    learners: Learners = "one"  # one: it races frozen opponents; all: every drone flies the newest policy and learns.
    evaluate_every: int = 500_000  # Environment steps between evaluations, T_eval.
    win_threshold: float = 0.6  # Win rate at which the policy replaces its opponents, tau.
    patience: int = 2  # Failed evaluations after which it replaces them all the same; 0: never.
    sparring_share: float = 0.1  # Share of training opponents that are scripted pilots of many speeds.
    league: int = 0  # Number of past policies kept as opponents, in half of the races; 0: only the latest.
    founders: tuple[str, ...] = ()  # Policies (names or paths) that stay in the league from start to end.
    vary_field: bool = False  # Train in races of 1 to N drones, uniformly drawn, in place of N.
    opponent_mass_spread: float = 0.0  # Largest relative difference of an opponent's mass, drawn for every race.
    opponent_thrust_spread: float = 0.0  # Largest relative difference of an opponent's thrust, drawn for every race.
    evaluation_races: int = 100  # Races per evaluation, n_eval.
    evaluation_steps: int = 300  # Time limit of an evaluation race [control steps].


@dataclass(frozen=True)
class Randomisation:
    """Domain randomisation: how far vehicle, air, gates and sensors may be from nominal, drawn for every race; 0: off.

    A spread s scales by U(1 - s, 1 + s). A sensor error is a normal bias of that standard deviation for the whole race,
    plus white noise of half of it at every control step.
    """

    mass_spread: float = 0.0  # Largest relative error of the mass.
    inertia_spread: float = 0.0  # Largest relative error of each moment of inertia.
    thrust_spread: float = 0.0  # Largest relative error of the rotors' thrust and torque.
    drag_spread: float = 0.0  # Largest relative error of the drag coefficients.
    lag_spread: float = 0.0  # Largest relative error of the time constants of rotors and rate loop.
    clip_share: float = 0.0  # Largest share of a saturated command that is clipped per rotor, not by priority.
    extra_delay: float = 0.0  # Largest extra action delay [s].
    extra_integral: float = 0.0  # Largest extra integral gain of the rate loop [1/s].
    extra_idle: float = 0.0  # Largest extra thrust of idle rotors, as a share of their highest.
    extra_curve: float = 0.0  # Largest extra share of the square of the command in the rotors' thrust.
    wind_speed: float = 0.0  # Largest speed of a steady horizontal wind [m/s].
    gust_speed: float = 0.0  # Root mean square of the turbulence, per axis [m/s].
    gate_shift: float = 0.0  # Largest displacement of a gate, per axis [m].
    gate_turn: float = 0.0  # Largest rotation of a gate about the vertical [rad].
    gate_tilt: float = 0.0  # Largest roll and pitch of a gate beyond its own [rad].
    solid_shift: float = 0.0  # Largest level displacement of a pole or wall, per axis [m].
    position_error: float = 0.0  # Standard deviation of the position estimate, per axis [m].
    velocity_error: float = 0.0  # Standard deviation of the velocity estimate, per axis [m/s].
    attitude_error: float = 0.0  # Standard deviation of the attitude estimate, per axis [rad].
    rate_error: float = 0.0  # Standard deviation of the angular velocity estimate, per axis [rad/s].

    def scaled(self, factor: float) -> "Randomisation":
        """All of it so many times as strong."""
        return Randomisation(**{name: factor * value for name, value in asdict(self).items()})


AROUND_THE_VEHICLE = frozenset(
    {
        *("gate_shift", "gate_turn", "gate_tilt", "solid_shift"),
        *("position_error", "velocity_error", "attitude_error", "rate_error"),
    }
)
OF_BODY_AND_AIR = frozenset(field.name for field in fields(Randomisation)) - AROUND_THE_VEHICLE


@dataclass(frozen=True)
class Firmware:
    """How a flight controller in the loop is set; `docs/firmware.md` says what each does."""

    settings: FirmwareSettings = "matched"  # gains computed from the vehicle, or those the firmware comes with
    cli: tuple[str, ...] = ()  # lines of a real drone's `diff all`, in place of both
    gyro_noise: float = 0.0  # standard deviation of every look at the gyro [rad/s]


@dataclass(frozen=True)
class InSimulator:
    """A vehicle that another simulator moves: what `vehicle` of a race or an evaluation in Python may be."""

    vehicle: str | PathLike[str] | Vehicle | None = None  # None: what the pilots were made for
    simulator: str = OUR_SIMULATOR  # one of `cruise.interop.simulators.SIMULATORS`
    firmware: Firmware = field(default_factory=Firmware)  # of the simulator betaflight


@dataclass(frozen=True)
class Sensing:
    """What a drone knows of gates, opponents and itself; `docs/sensing.md` has the model. With `exact` it knows all.

    Seeing a gate tells where it stands and, by it, where the drone is. Until a gate is seen it is where the map, or the
    last sighting, has it; between sightings the position estimate drifts with the errors of the velocity estimate.
    """

    sensing: SensingKind = "exact"  # exact: all is known; range: what is near; camera: what is near and in view.
    sensor_range: float = 15.0  # Nothing farther than this is seen [m].
    camera_tilt: float = 0.52  # Of the optical axis above the body's forward axis [rad].
    camera_width: float = 2.1  # Horizontal field of view [rad].
    camera_height: float = 1.6  # Vertical field of view [rad].
    sensor_rate: float = 30.0  # Looks per second, at most one per control step [Hz].
    sensor_latency: float = 0.04  # From a look to what is known of it [s].
    velocity_bias: float = 0.1  # Largest bias of the velocity estimate, per axis, for a whole race [m/s].
    drift_share: float = 0.01  # Largest scale error of the velocity estimate, per axis, for a whole race.
    fix_error: float = 0.05  # Standard deviation of the position that a sighting gives, per axis [m].
    opponents_by: Literal["sight", "radio"] = "sight"  # Opponents out of sight are not known, or tell where they are.
    radio_delay: float = 0.1  # From where an opponent is to where it is known to have been, by radio [s].


EXACT = Sensing()


@dataclass(frozen=True)
class TrainConfig:
    """Everything a training run depends on."""

    track: str = "ring"  # Name of a built-in track, a TOML file, `random`, or `any`.
    drones: int = 4  # Drones per race: the learner and its opponents.
    seed: int = 0  # Seed of all random numbers of the run.
    vehicle: str | Vehicle = "paper"  # Name of a built-in vehicle, a TOML file, or a vehicle of your own.
    start_from: str = ""  # Policy (name or path) whose parameters training starts from; none: random ones.
    against: str = ""  # Policy (name or path) that flies all opponents, fixed: train a best response; none: self-play.
    observation: ObservationKind = "extended"  # What the policy observes; `cruise observations` lists them.
    critic_observation: str = ""  # What the value network observes, without sensor errors; none: as the policy.
    vanilla: bool = False  # Train on the last stage only, for as many steps as all stages.
    step_scale: float = 1.0  # Multiplies the training steps of every stage.
    episode_steps: int = 300  # Time limit of a training episode, after which it is truncated [control steps].
    collision_distance: float = 0.4  # Distance at which two drones collide in training [m].
    spread_starts: float = 0.0  # Share of training races that start all along a track which has a start of its own.
    retry_share: float = 0.0  # Share of crashes after which a race goes on from where its rollout began, not anew.
    checkpoint_seconds: float = 30.0  # Time between checkpoints [s].
    reward: RewardWeights = field(default_factory=RewardWeights)
    reward_terms: tuple[str, ...] = ()  # Names of more reward terms, of --terms files; all that those declare.
    ppo: PPOConfig = field(default_factory=PPOConfig)
    opponents: SelfPlayConfig = field(default_factory=SelfPlayConfig)
    randomisation: Randomisation = field(default_factory=Randomisation)
    milder_share: float = 0.0  # Share of randomised training races whose randomisation is scaled by U(0, 1).
    nominal_share: float = 0.0  # Share of training races without randomisation.
    sensing: Sensing = field(default_factory=Sensing)

    @property
    def learners(self) -> int:
        """Drones of a race that are learned from: the first ones."""
        return self.drones if self.opponents.learners == "all" else 1

    @property
    def others_fly(self) -> tuple[str, ...]:
        """Options given that let opponents fly by other policies than the newest."""
        given = {"against": self.against, "league": self.opponents.league}
        return tuple(name for name, value in given.items() if value)

    @property
    def steps_per_update(self) -> int:
        """Environment steps of all learners in one rollout."""
        return self.ppo.races * self.learners * self.ppo.rollout_steps
