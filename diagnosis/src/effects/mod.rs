//! The library of effects, one file each.
//!
//! | name | place | in one line |
//! |---|---|---|
//! | `command_delay` | command | commands arrive late |
//! | `slew_limit` | command | commands are ramped |
//! | `dead_zone` | command | small commands do nothing |
//! | `velocity_saturation` | command | large commands are clipped |
//! | `gain_asymmetry` | command | the wheels answer unequally |
//! | `battery_sag` | command | all commands lose effect with time |
//! | `command_offset` | command | a constant is added |
//! | `actuator_lag` | command | the drive follows its command with a second time constant |
//! | `integral_action` | command | the speed loops integrate |
//! | `wheel_radius_mismatch` | measurement | the wheels' radii differ from those of the odometry |
//! | `track_width_error` | measurement | the odometry reckons with a wrong track |
//! | `wheel_eccentricity` | measurement | a wheel's speed ripples once or twice a turn |
//! | `sensor_delay` | measurement | measurements are late |
//! | `encoder_quantisation` | measurement | speeds are whole counts over an interval |
//! | `timestamp_jitter` | measurement | the stamps are off by chance |
//! | `torque_saturation` | dynamics | the drives' force is limited |
//! | `backlash` | dynamics | play in the gears of both wheels |
//! | `castor_drag` | dynamics | the drag of a castor that swings round or slides |
//! | `coulomb_friction` | dynamics | dry friction of constant size at both wheels |
//! | `coulomb_friction_one_wheel` | dynamics | dry friction at one wheel, or of another size at each |
//! | `direction_asymmetry` | dynamics | dry friction that differs forwards and backwards |
//! | `lateral_com_offset` | dynamics | the centre of mass lies to one side |
//! | `payload_change` | dynamics | mass and moment of inertia change at some time |
//! | `quadratic_drag` | dynamics | drag with the square of speed |
//! | `rolling_resistance` | dynamics | a constant force of every wheel that carries load, driven or not |
//! | `slope` | dynamics | a pull that depends on the heading |
//! | `stribeck_friction` | dynamics | dry friction that is greater near standstill |
//! | `turning_scrub` | dynamics | a resistance to turning that depends on speed |
//! | `viscous_asymmetry` | dynamics | viscous friction that differs between wheels or directions |
//! | `wheel_slip` | dynamics | the wheels slip while they push |

mod actuator_lag;
mod backlash;
mod battery_sag;
mod bristles;
mod castor_drag;
mod command_delay;
mod command_offset;
mod coulomb_friction;
mod coulomb_friction_one_wheel;
mod dead_zone;
mod direction_asymmetry;
mod encoder_quantisation;
mod force;
mod gain_asymmetry;
mod integral_action;
mod late;
mod lateral_com_offset;
mod loops;
mod moments;
mod parts;
mod payload_change;
mod quadratic_drag;
mod ramp;
mod reading;
mod rolling_resistance;
mod root;
mod sensor_delay;
mod slew_limit;
mod slope;
mod soft;
mod stribeck_friction;
mod supply;
mod swivel;
mod timestamp_jitter;
mod torque_saturation;
mod track_width_error;
mod trend;
mod turning_scrub;
mod velocity_saturation;
mod viscous_asymmetry;
mod wheel_eccentricity;
mod wheel_radius_mismatch;
mod wheel_slip;
mod words;

use wheelwright_core::Effect;

pub(crate) use late::FAMILY as LATENESS;
pub(crate) use words::digits;

pub use actuator_lag::ActuatorLag;
pub use backlash::Backlash;
pub use battery_sag::{BatterySag, SagLaw};
pub use castor_drag::{CastorDrag, CastorKind};
pub use command_delay::CommandDelay;
pub use command_offset::CommandOffset;
pub use coulomb_friction::{CoulombFriction, FrictionLaw};
pub use coulomb_friction_one_wheel::CoulombFrictionOneWheel;
pub use dead_zone::DeadZone;
pub use direction_asymmetry::DirectionAsymmetry;
pub use encoder_quantisation::EncoderQuantisation;
pub use force::Wheel;
pub use gain_asymmetry::GainAsymmetry;
pub use integral_action::IntegralAction;
pub use lateral_com_offset::LateralComOffset;
pub use parts::Axis;
pub use payload_change::{LoadLaw, PayloadChange};
pub use quadratic_drag::QuadraticDrag;
pub use rolling_resistance::RollingResistance;
pub use sensor_delay::SensorDelay;
pub use slew_limit::SlewLimit;
pub use slope::Slope;
pub use stribeck_friction::StribeckFriction;
pub use timestamp_jitter::TimestampJitter;
pub use torque_saturation::{TorqueLaw, TorqueSaturation};
pub use track_width_error::TrackWidthError;
pub use turning_scrub::{ScrubLaw, TurningScrub};
pub use velocity_saturation::VelocitySaturation;
pub use viscous_asymmetry::{Between, ViscousAsymmetry};
pub use wheel_eccentricity::{Ripple, WheelEccentricity};
pub use wheel_radius_mismatch::{Speeds, WheelRadiusMismatch};
pub use wheel_slip::{SlipLaw, WheelSlip};

/// The built-in effects in the order in which they are tried; effects with a side or an axis stand once for each.
pub fn library() -> Vec<Box<dyn Effect>> {
    let mut all = command_side();
    all.extend(dynamics());
    // One that takes its width off every command is dry friction but for the moment of reversal: the more common cause first.
    all.push(Box::new(DeadZone { subtracting: true, ..DeadZone::default() }));
    for axis in [Axis::V, Axis::Omega] {
        all.push(Box::new(DeadZone { subtracting: true, axis: Some(axis), ..DeadZone::default() }));
    }
    all.extend(sensors());
    // An offset says that something is off and not what: among equals it stands last.
    all.push(Box::new(CommandOffset {}));
    all
}

/// Effects between what was sent and what drives.
fn command_side() -> Vec<Box<dyn Effect>> {
    let mut all: Vec<Box<dyn Effect>> = vec![
        Box::new(CommandDelay::default()),
        Box::new(CommandDelay { each_axis: true }),
        Box::new(ActuatorLag::default()),
        Box::new(ActuatorLag { each_axis: true, ..ActuatorLag::default() }),
        Box::new(ActuatorLag { servo: true, ..ActuatorLag::default() }),
        Box::new(ActuatorLag { resonant: true, ..ActuatorLag::default() }),
        Box::new(SlewLimit::default()),
        Box::new(SlewLimit { wheels: true, ..SlewLimit::default() }),
        Box::new(SlewLimit { slowing: true, ..SlewLimit::default() }),
        Box::new(SlewLimit { wheels: true, slowing: true, ..SlewLimit::default() }),
        Box::new(SlewLimit { settling: true, ..SlewLimit::default() }),
        Box::new(SlewLimit { easing: true, ..SlewLimit::default() }),
        Box::new(DeadZone::default()),
        Box::new(DeadZone { servo: true, ..DeadZone::default() }),
        Box::new(DeadZone { holding: true, ..DeadZone::default() }),
        Box::new(VelocitySaturation::default()),
        Box::new(VelocitySaturation { soft: true, ..VelocitySaturation::default() }),
        Box::new(VelocitySaturation { together: true, ..VelocitySaturation::default() }),
        Box::new(TorqueSaturation::default()),
        Box::new(TorqueSaturation { law: TorqueLaw::Power }),
        Box::new(TorqueSaturation { law: TorqueLaw::Axes }),
        Box::new(TorqueSaturation { law: TorqueLaw::Soft }),
        Box::new(TorqueSaturation { law: TorqueLaw::Shared }),
        Box::new(GainAsymmetry::default()),
        Box::new(GainAsymmetry { servo: true }),
        Box::new(BatterySag::default()),
        Box::new(BatterySag { law: SagLaw::Settling, servo: false }),
        Box::new(BatterySag { law: SagLaw::Dropped, servo: false }),
        Box::new(BatterySag { law: SagLaw::Loaded, servo: false }),
        Box::new(BatterySag { law: SagLaw::Recovering, servo: false }),
        Box::new(BatterySag { law: SagLaw::Steady, servo: true }),
        Box::new(BatterySag { law: SagLaw::Settling, servo: true }),
        Box::new(BatterySag { law: SagLaw::Dropped, servo: true }),
        Box::new(BatterySag { law: SagLaw::Loaded, servo: true }),
        Box::new(BatterySag { law: SagLaw::Recovering, servo: true }),
        Box::new(IntegralAction::default()),
        Box::new(IntegralAction { leaky: true }),
    ];
    for axis in [Axis::V, Axis::Omega] {
        all.push(Box::new(SlewLimit { axis: Some(axis), ..SlewLimit::default() }));
        all.push(Box::new(DeadZone { axis: Some(axis), ..DeadZone::default() }));
        all.push(Box::new(DeadZone { axis: Some(axis), holding: true, ..DeadZone::default() }));
        all.push(Box::new(VelocitySaturation { axis: Some(axis), ..VelocitySaturation::default() }));
        all.push(Box::new(VelocitySaturation { axis: Some(axis), soft: true, ..VelocitySaturation::default() }));
    }
    for wheel in [Wheel::Left, Wheel::Right] {
        all.push(Box::new(DeadZone { wheel: Some(wheel), ..DeadZone::default() }));
    }
    all
}

/// Effects between what happened and what was recorded.
fn sensors() -> Vec<Box<dyn Effect>> {
    let mut all: Vec<Box<dyn Effect>> = vec![
        Box::new(WheelRadiusMismatch::default()),
        Box::new(WheelRadiusMismatch { speeds: Speeds::Ground, ..WheelRadiusMismatch::default() }),
        Box::new(TrackWidthError {}),
        Box::new(WheelEccentricity { wheel: Some(Wheel::Left), ripple: Ripple::Reading, oval: false }),
        Box::new(WheelEccentricity { wheel: Some(Wheel::Right), ripple: Ripple::Reading, oval: false }),
        Box::new(WheelEccentricity { wheel: Some(Wheel::Left), ripple: Ripple::Rolling, oval: false }),
        Box::new(WheelEccentricity { wheel: Some(Wheel::Right), ripple: Ripple::Rolling, oval: false }),
        Box::new(WheelEccentricity { wheel: Some(Wheel::Left), ripple: Ripple::Rolling, oval: true }),
        Box::new(WheelEccentricity { wheel: Some(Wheel::Right), ripple: Ripple::Rolling, oval: true }),
        Box::new(SensorDelay::default()),
        Box::new(SensorDelay { each_axis: true, ..SensorDelay::default() }),
        Box::new(SensorDelay { averaging: true, ..SensorDelay::default() }),
        Box::new(EncoderQuantisation::default()),
        Box::new(EncoderQuantisation { readout: true, ..EncoderQuantisation::default() }),
        Box::new(TimestampJitter::default()),
    ];
    for axis in [None, Some(Axis::V), Some(Axis::Omega)] {
        all.push(Box::new(VelocitySaturation { axis, recorded: true, ..VelocitySaturation::default() }));
    }
    all
}

/// Effects on the dynamics.
fn dynamics() -> Vec<Box<dyn Effect>> {
    vec![
        Box::new(CoulombFriction::default()),
        Box::new(CoulombFriction { law: FrictionLaw::Soft }),
        Box::new(CoulombFriction { law: FrictionLaw::Presliding }),
        Box::new(CoulombFriction { law: FrictionLaw::Warming }),
        Box::new(CoulombFriction { law: FrictionLaw::Geared }),
        Box::new(CoulombFriction { law: FrictionLaw::Sided }),
        Box::new(CoulombFrictionOneWheel { wheel: Some(Wheel::Left) }),
        Box::new(CoulombFrictionOneWheel { wheel: Some(Wheel::Right) }),
        Box::new(CoulombFrictionOneWheel { wheel: None }),
        Box::new(StribeckFriction::default()),
        Box::new(StribeckFriction { presliding: true }),
        Box::new(RollingResistance::default()),
        Box::new(RollingResistance { castor: Some(CastorKind::Ball) }),
        Box::new(RollingResistance { castor: Some(CastorKind::Swivel) }),
        Box::new(RollingResistance { castor: Some(CastorKind::Leading) }),
        Box::new(DirectionAsymmetry::default()),
        Box::new(DirectionAsymmetry { soft: true }),
        Box::new(ViscousAsymmetry::default()),
        Box::new(ViscousAsymmetry { thinning: true, ..ViscousAsymmetry::default() }),
        Box::new(ViscousAsymmetry { between: Between::Directions, ..ViscousAsymmetry::default() }),
        Box::new(QuadraticDrag::default()),
        Box::new(QuadraticDrag { wheels: true }),
        Box::new(LateralComOffset {}),
        Box::new(WheelSlip { law: SlipLaw::Creep }),
        Box::new(WheelSlip { law: SlipLaw::Grip }),
        Box::new(TurningScrub { law: ScrubLaw::Patch }),
        Box::new(TurningScrub { law: ScrubLaw::Angle }),
        Box::new(TurningScrub { law: ScrubLaw::Skid }),
        Box::new(TurningScrub { law: ScrubLaw::Understeer }),
        Box::new(CastorDrag::default()),
        Box::new(CastorDrag { kind: CastorKind::Leading, ..CastorDrag::default() }),
        Box::new(CastorDrag { kind: CastorKind::Ball, ..CastorDrag::default() }),
        Box::new(CastorDrag { soft: true, ..CastorDrag::default() }),
        Box::new(Slope::default()),
        Box::new(Slope { waves: true }),
        Box::new(PayloadChange::default()),
        Box::new(PayloadChange { law: LoadLaw::Undone }),
        Box::new(PayloadChange { law: LoadLaw::Gradual }),
        Box::new(Backlash { at_motor: true, ..Backlash::default() }),
        Box::new(Backlash { at_motor: true, bouncing: true }),
        Box::new(Backlash::default()),
    ]
}
