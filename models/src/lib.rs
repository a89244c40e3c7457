//! The built-in models of Wheelwright.
//!
//! One idea: every model here is a regressor, linear in its parameters and affine in the accelerations, with the closed
//! form of its accelerations beside it because that is the inner loop of every simulation.
//!
//! | name | inputs | outputs | source |
//! |---|---|---|---|
//! | [`vw-pd`](VwPdConfig) | `v_ref`, `omega_ref` | `v`, `omega` | Laut 2011, appendix A.3; De La Cruz and Carelli 2008 |
//! | [`wheel-pd`](WheelPdConfig) | `v_ref`, `omega_ref` | `v`, `omega` | Laut 2011, section 2.2 |
//! | [`wheel-voltage`](WheelVoltageConfig) | `u_left`, `u_right` | `vel_left`, `vel_right` | the motor equation of the FRC community's SysId |
//! | [`expression`](ExpressionConfig) | any | any | written in TOML |
//!
//! [`physics`] computes the parameters of the first two from masses, lengths and motor constants.

mod expression;
mod pd;
pub mod physics;
mod vw_pd;
mod wheel_pd;
mod wheel_voltage;

pub use expression::{ExpressionConfig, ExpressionModel, Ordered, ParameterConfig};
pub use pd::PdModel;
pub use vw_pd::VwPdConfig;
pub use wheel_pd::WheelPdConfig;
pub use wheel_voltage::{MotorResponse, WheelVoltage, WheelVoltageConfig};
