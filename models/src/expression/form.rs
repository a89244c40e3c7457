//! The form every equation must have: Σ factor · θ_j · x'_k, at most one parameter and one derivative in a product.
//!
//! Linearity is established by the structure of the expression, while it is taken apart: each node becomes a sum of
//! [`Part`]s, and a node that would multiply two parameters, or put one inside a function, is refused where it stands.

use super::parse::{Fault, Kind, Node, Operator};
use super::program::{Function, Program};
use wheelwright_core::config::nearest;

/// One product: factor · θ_parameter · x'_derivative.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Part {
    pub(super) parameter: Option<usize>,
    pub(super) derivative: Option<usize>,
    pub(super) factor: Program,
}

/// A sum of parts, no two of which have the same parameter and derivative.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Form(pub(super) Vec<Part>);

/// The names an expression may use.
#[derive(Debug)]
pub(super) struct Names<'a> {
    pub(super) inputs: Vec<&'a str>,
    pub(super) outputs: Vec<&'a str>,
    pub(super) parameters: Vec<&'a str>,
    pub(super) constants: Vec<(&'a str, f64)>,
}

impl Form {
    fn one(parameter: Option<usize>, derivative: Option<usize>, factor: Program) -> Self {
        Self(vec![Part { parameter, derivative, factor }])
    }

    fn plain(factor: Program) -> Self {
        Self::one(None, None, factor)
    }

    /// True if a parameter occurs.
    pub(super) fn has_parameter(&self) -> bool {
        self.0.iter().any(|p| p.parameter.is_some())
    }

    fn plus(mut self, other: Self) -> Self {
        for part in other.0 {
            match self.0.iter_mut().find(|p| (p.parameter, p.derivative) == (part.parameter, part.derivative)) {
                Some(same) => {
                    let factor = std::mem::replace(&mut same.factor, Program::Number(0.0));
                    same.factor = factor.plus(part.factor);
                }
                None => self.0.push(part),
            }
        }
        self
    }

    fn negated(self) -> Self {
        Self(self.0.into_iter().map(|p| Part { factor: p.factor.negated(), ..p }).collect())
    }

    /// The difference of two sides.
    pub(super) fn minus(self, other: Self) -> Self {
        self.plus(other.negated())
    }

    fn times(self, other: &Self, column: usize, names: &Names<'_>) -> Result<Self, Fault> {
        let mut product = Self::default();
        for a in &self.0 {
            for b in &other.0 {
                let parameter = single(a.parameter, b.parameter, |j, k| {
                    let (a, b) = (names.parameters[j], names.parameters[k]);
                    Fault::new(column, format!("`{a}` is multiplied by `{b}`: an equation must be linear in its parameters"))
                })?;
                let derivative = single(a.derivative, b.derivative, |j, k| {
                    let (a, b) = (names.outputs[j], names.outputs[k]);
                    Fault::new(column, format!("der({a}) is multiplied by der({b}): an equation must be affine in the derivatives"))
                })?;
                product = product.plus(Self::one(parameter, derivative, a.factor.clone().times(b.factor.clone())));
            }
        }
        Ok(product)
    }

    fn over(self, divisor: &Program) -> Self {
        Self(self.0.into_iter().map(|p| Part { factor: p.factor.over(divisor.clone()), ..p }).collect())
    }

    /// The value of a form in which neither parameters nor derivatives occur; `place` says where they would stand.
    fn value(self, column: usize, place: &str, names: &Names<'_>) -> Result<Program, Fault> {
        let mut value = Program::Number(0.0);
        for (i, part) in self.0.into_iter().enumerate() {
            if let Some(j) = part.parameter {
                let name = names.parameters[j];
                return Err(Fault::new(column, format!("`{name}` stands {place}: an equation must be linear in its parameters")));
            }
            if let Some(k) = part.derivative {
                let name = names.outputs[k];
                return Err(Fault::new(column, format!("der({name}) stands {place}: an equation must be affine in the derivatives")));
            }
            value = if i == 0 { part.factor } else { value.plus(part.factor) };
        }
        Ok(value)
    }
}

/// The one of two that is there.
fn single(a: Option<usize>, b: Option<usize>, both: impl Fn(usize, usize) -> Fault) -> Result<Option<usize>, Fault> {
    match (a, b) {
        (Some(a), Some(b)) => Err(both(a, b)),
        _ => Ok(a.or(b)),
    }
}

impl Names<'_> {
    /// Takes a tree apart.
    pub(super) fn form(&self, node: &Node) -> Result<Form, Fault> {
        match &node.kind {
            Kind::Number(x) => Ok(Form::plain(Program::Number(*x))),
            Kind::Name(name) => self.name(name, node.column),
            Kind::Negate(of) => Ok(self.form(of)?.negated()),
            Kind::Call(name, arguments) => self.call(name, arguments, node.column),
            Kind::Binary(operator, a, b) => self.binary(*operator, a, b, node.column),
        }
    }

    fn binary(&self, operator: Operator, a: &Node, b: &Node, column: usize) -> Result<Form, Fault> {
        let (left, right) = (self.form(a)?, self.form(b)?);
        match operator {
            Operator::Add => Ok(left.plus(right)),
            Operator::Subtract => Ok(left.minus(right)),
            Operator::Multiply => left.times(&right, column, self),
            Operator::Divide => {
                let divisor = right.value(b.column, "in a divisor", self)?;
                if divisor.constant() == Some(0.0) {
                    return Err(Fault::new(column, "this divides by zero"));
                }
                Ok(left.over(&divisor))
            }
            Operator::Power => {
                let base = left.value(a.column, "under an exponent", self)?;
                let exponent = right.value(b.column, "in an exponent", self)?;
                finite(base.raised_to(exponent), column)
            }
        }
    }

    fn name(&self, name: &str, column: usize) -> Result<Form, Fault> {
        let find = |names: &[&str]| names.iter().position(|n| *n == name);
        if let Some(i) = find(&self.inputs) {
            Ok(Form::plain(Program::Input(i)))
        } else if let Some(i) = find(&self.outputs) {
            Ok(Form::plain(Program::Output(i)))
        } else if let Some(j) = find(&self.parameters) {
            Ok(Form::one(Some(j), None, Program::Number(1.0)))
        } else if let Some((_, value)) = self.constants.iter().find(|(n, _)| *n == name) {
            Ok(Form::plain(Program::Number(*value)))
        } else if is_function(name) {
            Err(Fault::new(column, format!("`{name}` is a function: write {name}(...)")))
        } else {
            let known = self.all().chain(functions());
            let hint = nearest(name, known).map_or_else(|| self.listed(), |n| format!("did you mean `{n}`?"));
            Err(Fault::new(column, format!("nothing is named `{name}`; {hint}")))
        }
    }

    fn call(&self, name: &str, arguments: &[Node], column: usize) -> Result<Form, Fault> {
        if name == "der" {
            return self.derivative(arguments, column);
        }
        let Some(function) = Function::named(name) else {
            let message = if self.all().any(|n| n == name) {
                format!("`{name}` is no function; write {name}*(...) for a product")
            } else {
                let hint = nearest(name, functions()).map(|n| format!("did you mean `{n}`?"));
                let list = || format!("there are {}", functions().collect::<Vec<_>>().join(", "));
                format!("no function is named `{name}`; {}", hint.unwrap_or_else(list))
            };
            return Err(Fault::new(column, message));
        };
        let (needed, found) = (function.arguments(), arguments.len());
        if found != needed {
            return Err(Fault::new(column, format!("{name}() takes {needed} argument(s), not {found}")));
        }
        let place = format!("inside {}()", function.name());
        let value = |node: &Node| self.form(node)?.value(node.column, &place, self);
        let first = value(&arguments[0])?;
        let second = arguments.get(1).map_or(Ok(Program::Number(0.0)), value)?;
        finite(Program::call(function, first, second), column)
    }

    fn derivative(&self, arguments: &[Node], column: usize) -> Result<Form, Fault> {
        let [Node { kind: Kind::Name(name), column: at }] = arguments else {
            return Err(Fault::new(column, "der() takes the name of one output, as in der(v)"));
        };
        match self.outputs.iter().position(|n| n == name) {
            Some(k) => Ok(Form::one(None, Some(k), Program::Number(1.0))),
            None if self.inputs.contains(&name.as_str()) => {
                let message = format!("`{name}` is an input: inputs are held between samples and have no derivative");
                Err(Fault::new(*at, message))
            }
            None => {
                let hint = nearest(name, self.outputs.iter().copied()).map(|n| format!("; did you mean `{n}`?")).unwrap_or_default();
                Err(Fault::new(*at, format!("`{name}` is no output of this model{hint}")))
            }
        }
    }

    fn all(&self) -> impl Iterator<Item = &str> {
        let channels = self.inputs.iter().chain(&self.outputs).chain(&self.parameters).copied();
        channels.chain(self.constants.iter().map(|(name, _)| *name))
    }

    fn listed(&self) -> String {
        format!("there are {}", self.all().collect::<Vec<_>>().join(", "))
    }
}

/// A form of one value, unless it is a number that cannot be, such as ln(-1).
fn finite(value: Program, column: usize) -> Result<Form, Fault> {
    match value.constant().filter(|x| !x.is_finite()) {
        Some(x) => Err(Fault::new(column, format!("this is {x}, not a finite number"))),
        None => Ok(Form::plain(value)),
    }
}

/// Names of everything that can be called.
pub(super) fn functions<'a>() -> impl Iterator<Item = &'a str> {
    Function::ALL.iter().map(|(name, _)| *name).chain(std::iter::once("der"))
}

fn is_function(name: &str) -> bool {
    functions().any(|f| f == name)
}
