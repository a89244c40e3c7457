//! The four excitations of Laut 2011, all of `v_ref` and `omega_ref`: the two of its simulations (section 4.2) and the two
//! that drove its robots (section 4.4), as offsets and sums of sines.

use serde::{Deserialize, Serialize};

use super::{Excitation, ExcitationError, check_channel, check_duration};
use crate::channel::{Channel, OMEGA_REF, V_REF};

/// A constant and sines (amplitude, angular frequency \[rad/s\]), all in phase at t = 0.
#[derive(Debug)]
struct Tones {
    offset: f64,
    sines: &'static [(f64, f64)],
}

impl Tones {
    fn at(&self, t: f64) -> f64 {
        self.offset + self.sines.iter().map(|(amplitude, rate)| amplitude * (rate * t).sin()).sum::<f64>()
    }
}

/// Commands of the two channels.
#[derive(Debug)]
struct Pair {
    v: Tones,
    omega: Tones,
}

impl Pair {
    fn check(inputs: &[Channel]) -> Result<(), ExcitationError> {
        check_channel(&V_REF.name, inputs)?;
        check_channel(&OMEGA_REF.name, inputs)
    }

    fn command(&self, t: f64, inputs: &[Channel], command: &mut [f64]) {
        for (channel, value) in inputs.iter().zip(command) {
            *value = match &*channel.name {
                "v_ref" => self.v.at(t),
                "omega_ref" => self.omega.at(t),
                _ => 0.0,
            };
        }
    }
}

/// Defines one excitation of the thesis: its type, name, default duration, summary and signals.
macro_rules! thesis_excitation {
    ($(#[$doc:meta])* $type:ident, $name:literal, $seconds:literal, $about:literal, $pair:expr) => {
        $(#[$doc])*
        #[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
        #[serde(deny_unknown_fields, default)]
        pub struct $type {
            /// Length \[s\].
            pub duration: f64,
        }

        impl Default for $type {
            fn default() -> Self {
                Self { duration: $seconds }
            }
        }

        #[typetag::serde(name = $name)]
        impl Excitation for $type {
            fn about(&self) -> String {
                $about.to_owned()
            }

            fn duration(&self) -> f64 {
                self.duration
            }

            fn check(&self, inputs: &[Channel]) -> Result<(), ExcitationError> {
                check_duration(self.duration)?;
                Pair::check(inputs)
            }

            fn command(&self, t: f64, inputs: &[Channel], command: &mut [f64]) {
                static PAIR: Pair = $pair;
                PAIR.command(t, inputs, command);
            }
        }
    };
}

thesis_excitation!(
    /// v_ref = 0.4 + 0.1 (sin 2t + sin t + sin t/3 + sin t/11), omega_ref = 0.75 + 0.25 (sin 1.5t + sin t + sin t/2 + sin t/5):
    /// what drove the Pioneer for about two and a half minutes.
    ThesisPioneer,
    "thesis-pioneer",
    150.0,
    "what drove the Pioneer of Laut 2011: v_ref 0 to 0.8 m/s, omega_ref -0.25 to 1.75 rad/s, four sines each, 150 s",
    Pair {
        v: Tones { offset: 0.4, sines: &[(0.1, 2.0), (0.1, 1.0), (0.1, 1.0 / 3.0), (0.1, 1.0 / 11.0)] },
        omega: Tones { offset: 0.75, sines: &[(0.25, 1.5), (0.25, 1.0), (0.25, 0.5), (0.25, 0.2)] },
    }
);

thesis_excitation!(
    /// v_ref = 0.1 + 0.05 (sin 2t + sin t + sin t/3 + sin t/11), omega_ref = 1.5 + 0.5 sin 1.5t + 0.5 sin t + 0.25 sin t/2 +
    /// 0.25 sin t/5: what drove the Khepera for two minutes.
    ThesisKhepera,
    "thesis-khepera",
    120.0,
    "what drove the Khepera of Laut 2011: v_ref -0.1 to 0.3 m/s, omega_ref 0 to 3 rad/s, four sines each, 120 s",
    Pair {
        v: Tones { offset: 0.1, sines: &[(0.05, 2.0), (0.05, 1.0), (0.05, 1.0 / 3.0), (0.05, 1.0 / 11.0)] },
        omega: Tones { offset: 1.5, sines: &[(0.5, 1.5), (0.5, 1.0), (0.25, 0.5), (0.25, 0.2)] },
    }
);

thesis_excitation!(
    /// v_ref = 1, omega_ref = 1 from rest (simulation case 1). Only the start-up shows the dynamics: a degenerate excitation, kept
    /// to compare with. The thesis does not state its length; thirty seconds are a hundred time constants of its robot.
    ThesisConstant,
    "thesis-constant",
    30.0,
    "constant commands v_ref = 1 m/s and omega_ref = 1 rad/s, case 1 of Laut 2011: nearly uninformative, to compare with",
    Pair { v: Tones { offset: 1.0, sines: &[] }, omega: Tones { offset: 1.0, sines: &[] } }
);

thesis_excitation!(
    /// v_ref = 0.2 sin t + 0.1 sin 1.5t + 0.1 sin 3t + 0.1 sin 0.1t + 0.08 sin 0.013t + 0.1 sin 5t,
    /// omega_ref = (5π/3) sin 2t + 0.1 sin 0.1t + 0.1 sin 0.09t (simulation case 2). The thesis does not state its length; 150 s
    /// hold two periods of every tone but the slowest.
    ThesisMultisine,
    "thesis-multisine",
    150.0,
    "case 2 of Laut 2011: six sines of v_ref to 0.6 m/s, three of omega_ref to 5.4 rad/s, 150 s",
    Pair {
        v: Tones { offset: 0.0, sines: &[(0.2, 1.0), (0.1, 1.5), (0.1, 3.0), (0.1, 0.1), (0.08, 0.013), (0.1, 5.0)] },
        omega: Tones { offset: 0.0, sines: &[(5.0 * std::f64::consts::PI / 3.0, 2.0), (0.1, 0.1), (0.1, 0.09)] },
    }
);

#[cfg(test)]
mod tests {
    use super::*;

    const INPUTS: [Channel; 2] = [V_REF, OMEGA_REF];

    fn at(excitation: &dyn Excitation, t: f64) -> (f64, f64) {
        let mut command = [f64::NAN; 2];
        excitation.command(t, &INPUTS, &mut command);
        (command[0], command[1])
    }

    /// numpy: `.2*sin(t)+.1*sin(1.5*t)+.1*sin(3*t)+.1*sin(.1*t)+.08*sin(.013*t)+.1*sin(5*t)` and so on, at 0, 1.7, 33.3, 119.9 s.
    #[test]
    fn values_are_those_of_the_formulas() {
        let multisine = [
            (0.0, 0.0, 0.0),
            (1.7, 0.260_054_667_851_278_6, -1.305_851_469_577_503_6),
            (33.3, 0.115_517_816_190_975_13, -3.074_478_735_769_403_2),
            (119.9, 0.206_274_408_705_221_62, 4.360_361_301_131_435),
        ];
        let khepera = [
            (0.0, 0.1, 1.5),
            (1.7, 0.171_343_870_751_374_9, 2.545_866_138_242_219),
            (33.3, 0.074_224_510_287_547_65, 1.710_327_503_877_922_2),
            (119.9, 0.156_489_733_399_955_96, 1.104_174_853_100_318),
        ];
        let pioneer = [
            (0.0, 0.4, 0.75),
            (1.7, 0.542_687_741_502_749_8, 1.408_529_006_281_248),
            (33.3, 0.348_449_020_575_095_3, 0.800_064_107_665_315_5),
            (119.9, 0.512_979_466_799_911_9, 0.405_748_783_476_333_2),
        ];
        let check = |excitation: &dyn Excitation, expected: [(f64, f64, f64); 4]| {
            for (t, v, omega) in expected {
                let found = at(excitation, t);
                assert!((found.0 - v).abs() < 1e-13 && (found.1 - omega).abs() < 1e-13, "{excitation:?} t = {t}: {found:?}");
            }
        };
        check(&ThesisMultisine::default(), multisine);
        check(&ThesisKhepera::default(), khepera);
        check(&ThesisPioneer::default(), pioneer);
        check(&ThesisConstant::default(), [0.0, 1.7, 33.3, 119.9].map(|t| (t, 1.0, 1.0)));
    }

    #[test]
    fn durations() {
        assert_eq!(ThesisPioneer::default().duration(), 150.0);
        assert_eq!(ThesisKhepera::default().duration(), 120.0);
        let error = ThesisPioneer { duration: 0.0 }.check(&INPUTS).unwrap_err();
        assert_eq!(error.to_string(), "`duration`: must be a number of seconds above zero, not 0");
        assert!(ThesisPioneer { duration: f64::NAN }.check(&INPUTS).is_err());
    }

    #[test]
    fn a_robot_without_these_commands_is_refused() {
        let error = ThesisKhepera::default().check(&[crate::channel::U_LEFT, crate::channel::U_RIGHT]).unwrap_err();
        assert_eq!(error.to_string(), "the robot has no command `v_ref`; it takes `u_left` and `u_right`");
    }
}
