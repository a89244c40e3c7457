//! Built-in solvers: from a model and a data set to parameters.
//!
//! One idea: every equation of a model is linear in its parameters, so a recording of any length folds into one small
//! triangle an equation ([`triangle`]), and what a solver does afterwards costs nothing.
//!
//! | name | minimises | keeps bounds |
//! |---|---|---|
//! | `thesis` | the regression of Laut (2011), to the letter: biased, for comparison | no |
//! | `ols` | the regression with every column filtered alike, then the zero-order hold is undone | no |
//! | `box` | the same within bounds | yes |
//! | `steady-state` | the equations at rest over constant stretches; the rest by `ols` | no |
//! | `output-error` | the free-run simulation error, weighted by its noise model: the reference | yes |
//! | `iv` | nothing: makes the free-run error orthogonal to instruments from the free run | yes |
//! | `robust` | the free-run simulation error under Huber's loss, for outliers and dropouts | yes |
//! | `recursive` | the integral form of the regression, sample by sample in constant memory, and a free run beside it | no |
//!
//! All honour [`ParameterMap`](wheelwright_core::ParameterMap), θ = T z + c: columns Φ T, response y − Φ c. Only
//! `output-error`, `iv` and `recursive` state standard errors: residuals of a filtered regression are so strongly correlated that the textbook
//! formula covers 28-33 % instead of 95 %, and an interval that does not cover is worse than none.

mod bounded;
mod hold;
mod iv;
mod ols;
mod output_error;
mod prefilter;
mod quadratic;
mod recursive;
mod regression;
mod robust;
mod steady_state;
mod thesis;
pub mod triangle;

pub use bounded::BoundedSolver;
pub use hold::Hold;
pub use iv::InstrumentalVariables;
pub use ols::Ols;
pub use output_error::{NoiseModel, OutputError, Velocity};
pub use quadratic::Quadratic;
pub use recursive::{DIFFERENCED, Estimator, Recursive, Stage};
pub use regression::{LeastSquares, SolverRegression, System};
pub use robust::Robust;
pub use steady_state::SteadyState;
pub use thesis::Thesis;
