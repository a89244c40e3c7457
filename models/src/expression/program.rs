//! Programs: what is left of an expression when parameters and derivatives have been taken out of it, as a tree that is
//! evaluated on the channels without allocation.

/// Functions of one or two numbers that an expression may call.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Function {
    Sin,
    Cos,
    Tan,
    Exp,
    Ln,
    Sqrt,
    Abs,
    Sign,
    Tanh,
    Min,
    Max,
}

impl Function {
    /// Every function under its name.
    pub(super) const ALL: [(&'static str, Self); 11] = [
        ("sin", Self::Sin),
        ("cos", Self::Cos),
        ("tan", Self::Tan),
        ("exp", Self::Exp),
        ("ln", Self::Ln),
        ("sqrt", Self::Sqrt),
        ("abs", Self::Abs),
        ("sign", Self::Sign),
        ("tanh", Self::Tanh),
        ("min", Self::Min),
        ("max", Self::Max),
    ];

    pub(super) fn named(name: &str) -> Option<Self> {
        Self::ALL.iter().find(|(known, _)| *known == name).map(|(_, function)| *function)
    }

    pub(super) fn name(self) -> &'static str {
        Self::ALL.iter().find(|(_, function)| *function == self).map_or("", |(name, _)| name)
    }

    /// Number of arguments.
    pub(super) fn arguments(self) -> usize {
        if matches!(self, Self::Min | Self::Max) { 2 } else { 1 }
    }

    /// Value; `b` is read by `min` and `max` only.
    fn of(self, a: f64, b: f64) -> f64 {
        match self {
            Self::Sin => a.sin(),
            Self::Cos => a.cos(),
            Self::Tan => a.tan(),
            Self::Exp => a.exp(),
            Self::Ln => a.ln(),
            Self::Sqrt => a.sqrt(),
            Self::Abs => a.abs(),
            // Unlike `signum`, zero at zero.
            Self::Sign => f64::from(i8::from(a > 0.0) - i8::from(a < 0.0)),
            Self::Tanh => a.tanh(),
            Self::Min => a.min(b),
            Self::Max => a.max(b),
        }
    }
}

/// A function of the channels.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Program {
    Number(f64),
    Input(usize),
    Output(usize),
    Add(Box<Self>, Box<Self>),
    Multiply(Box<Self>, Box<Self>),
    Divide(Box<Self>, Box<Self>),
    Power(Box<Self>, Box<Self>),
    /// Power with a small whole exponent, which multiplies instead of taking logarithms.
    WholePower(Box<Self>, i32),
    Call(Function, Box<Self>, Box<Self>),
}

impl Program {
    /// Value on the channels.
    pub(super) fn evaluate(&self, inputs: &[f64], outputs: &[f64]) -> f64 {
        let of = |program: &Self| program.evaluate(inputs, outputs);
        match self {
            Self::Number(x) => *x,
            Self::Input(i) => inputs[*i],
            Self::Output(i) => outputs[*i],
            Self::Add(a, b) => of(a) + of(b),
            Self::Multiply(a, b) => of(a) * of(b),
            Self::Divide(a, b) => of(a) / of(b),
            Self::Power(a, b) => of(a).powf(of(b)),
            Self::WholePower(a, n) => of(a).powi(*n),
            Self::Call(function, a, b) => function.of(of(a), of(b)),
        }
    }

    pub(super) fn plus(self, other: Self) -> Self {
        match (self, other) {
            (Self::Number(a), Self::Number(b)) => Self::Number(a + b),
            (a, b) => Self::Add(Box::new(a), Box::new(b)),
        }
    }

    pub(super) fn times(self, other: Self) -> Self {
        match (self, other) {
            (Self::Number(a), Self::Number(b)) => Self::Number(a * b),
            (Self::Number(0.0), _) | (_, Self::Number(0.0)) => Self::Number(0.0),
            (Self::Number(1.0), b) => b,
            (a, Self::Number(1.0)) => a,
            (a, b) => Self::Multiply(Box::new(a), Box::new(b)),
        }
    }

    pub(super) fn over(self, other: Self) -> Self {
        match (self, other) {
            (Self::Number(a), Self::Number(b)) => Self::Number(a / b),
            (a, b) => Self::Divide(Box::new(a), Box::new(b)),
        }
    }

    pub(super) fn negated(self) -> Self {
        Self::Number(-1.0).times(self)
    }

    pub(super) fn raised_to(self, exponent: Self) -> Self {
        match (self, exponent) {
            (Self::Number(a), Self::Number(b)) => Self::Number(a.powf(b)),
            (a, Self::Number(n)) if n.fract() == 0.0 && n.abs() <= 64.0 => Self::WholePower(Box::new(a), n as i32),
            (a, b) => Self::Power(Box::new(a), Box::new(b)),
        }
    }

    pub(super) fn call(function: Function, a: Self, b: Self) -> Self {
        match (a, b) {
            (Self::Number(a), Self::Number(b)) => Self::Number(function.of(a, b)),
            (a, b) => Self::Call(function, Box::new(a), Box::new(b)),
        }
    }

    /// Its value, if that does not change with the channels.
    pub(super) fn constant(&self) -> Option<f64> {
        match self {
            Self::Number(x) => Some(*x),
            _ => None,
        }
    }
}
