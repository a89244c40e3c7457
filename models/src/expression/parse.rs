//! From text to a tree: recursive descent over
//!
//! ```text
//! equation = sum "=" sum
//! sum      = product { ("+" | "-") product }
//! product  = unary { ("*" | "/") unary }
//! unary    = ("-" | "+") unary | power
//! power    = atom [ "^" unary ]
//! atom     = number | name | name "(" sum { "," sum } ")" | "(" sum ")"
//! ```

/// Longest equation read, in characters: bounds the depth of the tree, and with it of every recursion over it.
const LONGEST: usize = 2000;
/// Deepest nesting of parentheses, signs and exponents.
const DEEPEST: usize = 64;

/// What is wrong with an equation, and at which character from 1.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Fault {
    pub(super) column: usize,
    pub(super) message: String,
}

impl Fault {
    pub(super) fn new(column: usize, message: impl Into<String>) -> Self {
        Self { column, message: message.into() }
    }
}

/// An operation on two values.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Operator {
    Add,
    Subtract,
    Multiply,
    Divide,
    Power,
}

/// A part of an equation and where it stands.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Node {
    pub(super) column: usize,
    pub(super) kind: Kind,
}

#[derive(Debug, Clone, PartialEq)]
pub(super) enum Kind {
    Number(f64),
    Name(String),
    Negate(Box<Node>),
    Binary(Operator, Box<Node>, Box<Node>),
    Call(String, Vec<Node>),
}

/// Reads an equation: its two sides.
pub(super) fn equation(text: &str) -> Result<(Node, Node), Fault> {
    let length = text.chars().count();
    if length > LONGEST {
        return Err(Fault::new(LONGEST + 1, format!("the equation has {length} characters: at most {LONGEST} are read")));
    }
    let mut parser = Parser { tokens: tokens(text)?, next: 0, depth: 0 };
    let left = parser.sum()?;
    if !parser.take('=') {
        return Err(parser.unexpected("an operator, or the = between the two sides,"));
    }
    let right = parser.sum()?;
    match parser.peek() {
        Token::End => Ok((left, right)),
        _ => Err(parser.unexpected("an operator or the end of the equation")),
    }
}

#[derive(Debug, Clone, PartialEq)]
enum Token {
    Number(f64),
    Name(String),
    Symbol(char),
    End,
}

/// Tokens with the columns at which they begin.
fn tokens(text: &str) -> Result<Vec<(Token, usize)>, Fault> {
    let chars: Vec<char> = text.chars().collect();
    let mut tokens = Vec::new();
    let mut at = 0;
    while at < chars.len() {
        let start = at;
        let c = chars[at];
        let run = |from: usize, holds: &dyn Fn(char) -> bool| chars[from..].iter().take_while(|c| holds(**c)).count();
        if c.is_whitespace() {
            at += 1;
            continue;
        } else if c.is_ascii_digit() || c == '.' {
            at += run(at, &|c| c.is_ascii_digit() || c == '.');
            at += exponent(&chars[at..]);
            let digits: String = chars[start..at].iter().collect();
            let number = digits.parse::<f64>().ok().filter(|x| x.is_finite());
            let number = number.ok_or_else(|| Fault::new(start + 1, format!("`{digits}` is not a number")))?;
            tokens.push((Token::Number(number), start + 1));
        } else if c.is_ascii_alphabetic() || c == '_' {
            at += run(at, &|c| c.is_ascii_alphanumeric() || c == '_');
            tokens.push((Token::Name(chars[start..at].iter().collect()), start + 1));
        } else if "+-*/^(),=".contains(c) {
            at += 1;
            tokens.push((Token::Symbol(c), start + 1));
        } else {
            let what = "names, numbers and + - * / ^ ( ) , = make an equation";
            return Err(Fault::new(start + 1, format!("`{c}` has no meaning here: {what}")));
        }
    }
    tokens.push((Token::End, chars.len() + 1));
    Ok(tokens)
}

/// Length of `e-3` and the like at the beginning of the characters; zero where there is none.
fn exponent(chars: &[char]) -> usize {
    let sign = usize::from(matches!(chars.get(1), Some('+' | '-')));
    let digits = chars.iter().skip(1 + sign).take_while(|c| c.is_ascii_digit()).count();
    if matches!(chars.first(), Some('e' | 'E')) && digits > 0 { 1 + sign + digits } else { 0 }
}

struct Parser {
    tokens: Vec<(Token, usize)>,
    next: usize,
    depth: usize,
}

impl Parser {
    fn peek(&self) -> &Token {
        &self.tokens[self.next].0
    }

    fn column(&self) -> usize {
        self.tokens[self.next].1
    }

    /// Goes over the next token, never over the end.
    fn advance(&mut self) {
        self.next = (self.next + 1).min(self.tokens.len() - 1);
    }

    fn take(&mut self, symbol: char) -> bool {
        let found = *self.peek() == Token::Symbol(symbol);
        if found {
            self.advance();
        }
        found
    }

    fn unexpected(&self, expected: &str) -> Fault {
        let found = match self.peek() {
            Token::Number(x) => format!("`{x}`"),
            Token::Name(name) => format!("`{name}`"),
            Token::Symbol(c) => format!("`{c}`"),
            Token::End => "the end".to_owned(),
        };
        Fault::new(self.column(), format!("{expected} is expected here, not {found}"))
    }

    /// Runs a rule one level deeper.
    fn nested(&mut self, rule: impl FnOnce(&mut Self) -> Result<Node, Fault>) -> Result<Node, Fault> {
        if self.depth == DEEPEST {
            return Err(Fault::new(self.column(), format!("nested more than {DEEPEST} levels deep")));
        }
        self.depth += 1;
        let node = rule(self);
        self.depth -= 1;
        node
    }

    fn sum(&mut self) -> Result<Node, Fault> {
        self.chain(&[('+', Operator::Add), ('-', Operator::Subtract)], Self::product)
    }

    fn product(&mut self) -> Result<Node, Fault> {
        self.chain(&[('*', Operator::Multiply), ('/', Operator::Divide)], Self::unary)
    }

    /// Operands of one rank, joined from left to right.
    fn chain(&mut self, operators: &[(char, Operator)], operand: fn(&mut Self) -> Result<Node, Fault>) -> Result<Node, Fault> {
        let mut left = operand(self)?;
        loop {
            let column = self.column();
            let Some((_, operator)) = operators.iter().find(|(symbol, _)| self.take(*symbol)) else { return Ok(left) };
            let right = operand(self)?;
            left = Node { column, kind: Kind::Binary(*operator, Box::new(left), Box::new(right)) };
        }
    }

    fn unary(&mut self) -> Result<Node, Fault> {
        let column = self.column();
        if self.take('-') {
            let of = self.nested(Self::unary)?;
            return Ok(Node { column, kind: Kind::Negate(Box::new(of)) });
        }
        if self.take('+') { self.nested(Self::unary) } else { self.power() }
    }

    fn power(&mut self) -> Result<Node, Fault> {
        let base = self.atom()?;
        let column = self.column();
        if !self.take('^') {
            return Ok(base);
        }
        let exponent = self.nested(Self::unary)?;
        Ok(Node { column, kind: Kind::Binary(Operator::Power, Box::new(base), Box::new(exponent)) })
    }

    fn atom(&mut self) -> Result<Node, Fault> {
        let column = self.column();
        let token = self.peek().clone();
        match token {
            Token::Number(x) => {
                self.advance();
                Ok(Node { column, kind: Kind::Number(x) })
            }
            Token::Name(name) => {
                self.advance();
                let kind = if self.take('(') { Kind::Call(name, self.arguments()?) } else { Kind::Name(name) };
                Ok(Node { column, kind })
            }
            Token::Symbol('(') => {
                self.advance();
                let inner = self.nested(Self::sum)?;
                if self.take(')') { Ok(inner) } else { Err(self.unexpected("an operator or the closing )")) }
            }
            _ => Err(self.unexpected("a number, a name or (")),
        }
    }

    fn arguments(&mut self) -> Result<Vec<Node>, Fault> {
        let mut arguments = vec![self.nested(Self::sum)?];
        while self.take(',') {
            arguments.push(self.nested(Self::sum)?);
        }
        if self.take(')') { Ok(arguments) } else { Err(self.unexpected("an operator, a comma or the closing )")) }
    }
}
