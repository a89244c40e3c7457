//! Rates with Wilson's score interval (J. Am. Stat. Assoc. 22, 1927), which holds also for few cases and rates near 0 and 1.

use serde::Serialize;
use serde_json::{Value, json};

/// Quantile of the normal distribution for 95 %, two-sided.
const Z: f64 = 1.959_963_984_540_054;

/// So many of so many.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct Rate {
    /// Cases that count.
    pub hits: usize,
    /// Cases there are.
    pub of: usize,
}

impl Rate {
    /// The rate of what holds; `None` does not take part.
    pub fn of(answers: impl Iterator<Item = Option<bool>>) -> Self {
        answers.flatten().fold(Self::default(), |rate, hit| Self { hits: rate.hits + usize::from(hit), of: rate.of + 1 })
    }

    /// Share; `None` without cases.
    pub fn share(self) -> Option<f64> {
        (self.of > 0).then(|| self.hits as f64 / self.of as f64)
    }

    /// Wilson's 95 % interval; `None` without cases.
    pub fn wilson(self) -> Option<(f64, f64)> {
        let (n, p) = (self.of as f64, self.share()?);
        let centre = (p + Z * Z / (2.0 * n)) / (1.0 + Z * Z / n);
        let half = Z / (1.0 + Z * Z / n) * (p * (1.0 - p) / n + Z * Z / (4.0 * n * n)).sqrt();
        Some(((centre - half).max(0.0), (centre + half).min(1.0)))
    }

    /// As a document.
    pub fn document(self) -> Value {
        json!({ "hits": self.hits, "of": self.of, "rate": self.share(), "wilson95": self.wilson().map(|(a, b)| [a, b]) })
    }

    /// `97.5 % (39/40; 87.1–99.6)`, or a dash.
    pub fn text(self) -> String {
        match (self.share(), self.wilson()) {
            (Some(share), Some((low, high))) => {
                format!("{:.1} % ({}/{}; {:.1}–{:.1})", 100.0 * share, self.hits, self.of, 100.0 * low, 100.0 * high)
            }
            _ => "—".to_owned(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_interval_is_wilsons() {
        // from scipy.stats import binomtest
        // binomtest(39, 40).proportion_ci(method="wilson"), binomtest(0, 300)..., binomtest(7, 7)...
        for (hits, of, low, high) in
            [(39, 40, 0.871_186_3, 0.995_573_2), (0, 300, 0.0, 0.012_643_0), (7, 7, 0.645_669_6, 1.0), (28, 60, 0.346_279_1, 0.591_065_7)]
        {
            let (a, b) = Rate { hits, of }.wilson().unwrap();
            assert!((a - low).abs() < 1e-6 && (b - high).abs() < 1e-6, "{hits}/{of}: {a} {b}");
        }
        assert_eq!(Rate::default().text(), "—");
        assert_eq!(Rate::of([Some(true), None, Some(false)].into_iter()), Rate { hits: 1, of: 2 });
    }
}
