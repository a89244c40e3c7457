//! Built-in trajectories and tracking controllers of Wheelwright.
//!
//! One idea: a model's equation Φ(inputs, outputs, accelerations) θ = y, evaluated at the acceleration σ that a kinematic
//! law wants, *is* the inverse-dynamics command, and the same Φ times the velocity error is the adaptation law:
//!
//! command = Φ(σ) θ,   θ' = γ Φ(σ)ᵀ (wanted − measured velocity)                              (3.8)–(3.13), (3.21)
//!
//! So any model that tells how the body moves can be controlled with, not only the thesis' own. Numbers of equations are
//! those of Laut 2011.
//!
//! | controller | command |
//! |---|---|
//! | [`kinematic`](KinematicConfig) | the wanted velocities (4.8) themselves |
//! | [`inverse-dynamics`](InverseDynamicsConfig) | Φ(σ) θ with fixed θ |
//! | [`adaptive`](AdaptiveConfig) | Φ(σ) θ with θ adapted |
//!
//! Trajectories: [`figure-eight`](trajectory::FigureEight), [`circle`](trajectory::Circle), [`line`](trajectory::Line),
//! [`waypoints`](trajectory::Waypoints).

pub mod adaptation;
mod adaptive;
mod balance;
pub mod body;
pub mod continuous;
mod inverse_dynamics;
pub mod kinematic;
pub mod law;
pub mod migration;
pub mod saturation;
pub mod stability;
pub mod trajectory;

pub use adaptive::AdaptiveConfig;
pub use inverse_dynamics::InverseDynamicsConfig;
pub use kinematic::KinematicConfig;
