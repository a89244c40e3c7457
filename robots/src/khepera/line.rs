//! One line out, one line in: the robot loses whatever is sent before it has answered.

use std::time::{Duration, Instant};

use wheelwright_core::robot::RobotError;

use crate::wire::Link;

/// Tries of a command before the robot is given up.
const TRIES: u32 = 3;
/// A line that is quiet for this long has nothing more to say.
const QUIET: Duration = Duration::from_millis(30);
/// A line longer than this is no answer.
const LONGEST_LINE: usize = 512;

/// An open line with nothing under way.
#[derive(Debug)]
pub(super) struct Line {
    link: Link,
    buffer: Vec<u8>,
    timeout: Duration,
    /// Answers that never came.
    missing: u64,
}

impl Line {
    pub(super) fn new(link: Link, timeout: f64) -> Self {
        Self { link, buffer: Vec::new(), timeout: Duration::from_secs_f64(timeout), missing: 0 }
    }

    /// Sends a command and returns the values of its answer. Every command sent here may be sent twice: it sets or reads.
    pub(super) fn ask(&mut self, command: &str) -> Result<Vec<String>, RobotError> {
        let letter = command.chars().next().map_or('$', |c| c.to_ascii_lowercase());
        for _ in 0..TRIES {
            self.link.send(format!("{command}\n").as_bytes())?;
            match self.answer(letter)? {
                Some(Answer::Values(values)) => return Ok(values),
                Some(Answer::Refused) => {
                    return Err(RobotError::Fault(format!("it does not know the command `{command}`; is it a Khepera III or IV?")));
                }
                None => {
                    self.missing += 1;
                    self.resynchronise()?;
                }
            }
        }
        Err(RobotError::Timeout { limit_s: (TRIES * self.timeout).as_secs_f64(), what: format!("the answer to `{command}`") })
    }

    /// Tells without insisting on an answer, for a robot that must stand whatever the line is like.
    pub(super) fn tell(&mut self, command: &str) -> Result<(), RobotError> {
        self.link.send(format!("{command}\n").as_bytes())
    }

    /// Answers that never came.
    pub(super) fn missing(&self) -> u64 {
        self.missing
    }

    /// Ends a half command on the robot's side and throws away what it still had to say.
    pub(super) fn resynchronise(&mut self) -> Result<(), RobotError> {
        self.link.send(b"\n")?;
        let end = Instant::now() + self.timeout;
        let mut heard = Vec::new();
        while self.link.receive(&mut heard, QUIET)? > 0 && Instant::now() < end {
            heard.clear();
        }
        self.buffer.clear();
        Ok(())
    }

    /// The answer with that letter; older answers are passed over. `None` if there is none in time.
    fn answer(&mut self, letter: char) -> Result<Option<Answer>, RobotError> {
        let end = Instant::now() + self.timeout;
        loop {
            while let Some(line) = next_line(&mut self.buffer) {
                let mut words = line.split(',');
                match words.next() {
                    Some("$") => return Ok(Some(Answer::Refused)),
                    Some(first) if first.len() == 1 && first.starts_with(letter) => {
                        return Ok(Some(Answer::Values(words.map(|w| w.trim().to_owned()).collect())));
                    }
                    _ => {}
                }
            }
            let wait = end.saturating_duration_since(Instant::now());
            if wait.is_zero() || self.buffer.len() > LONGEST_LINE {
                return Ok(None);
            }
            self.link.receive(&mut self.buffer, wait)?;
        }
    }
}

enum Answer {
    Values(Vec<String>),
    Refused,
}

/// The next whole line, without its ending.
pub(super) fn next_line(buffer: &mut Vec<u8>) -> Option<String> {
    let end = buffer.iter().position(|b| *b == b'\n')?;
    let line = String::from_utf8_lossy(&buffer[..end]).trim().to_owned();
    buffer.drain(..=end);
    Some(line)
}

/// The two integers of an answer.
pub(super) fn two(values: &[String], command: &str) -> Result<[i32; 2], RobotError> {
    let parsed: Vec<i32> = values.iter().filter_map(|v| v.parse().ok()).collect();
    match (parsed.as_slice(), values.len()) {
        (&[left, right], 2) => Ok([left, right]),
        _ => Err(RobotError::Fault(format!("its answer to `{command}` is `{}`, not two integers", values.join(",")))),
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn answers_of_two_integers_are_read_and_others_refused() {
        let values = |text: &str| text.split(',').map(str::to_owned).collect::<Vec<_>>();
        assert_eq!(two(&values("-20850,20851"), "E").unwrap(), [-20850, 20851]);
        for wrong in ["", "1", "1,2,3", "1,x", "1,99999999999"] {
            assert!(matches!(two(&values(wrong), "E"), Err(RobotError::Fault(_))), "{wrong}");
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(2048))]
        #[test]
        fn lines_are_found_in_any_bytes(before in proptest::collection::vec(any::<u8>(), 0..80), cut in 0..100_usize) {
            let stream = [&before[..], b"\ne,1,-2\r\n"].concat();
            let (first, second) = stream.split_at(cut.min(stream.len()));
            let mut buffer = first.to_vec();
            let mut lines: Vec<String> = std::iter::from_fn(|| next_line(&mut buffer)).collect();
            buffer.extend_from_slice(second);
            lines.extend(std::iter::from_fn(|| next_line(&mut buffer)));
            prop_assert_eq!(lines.last().map(String::as_str), Some("e,1,-2"));
            for line in lines {
                let _ = two(&line.split(',').map(str::to_owned).collect::<Vec<_>>(), "E");
            }
        }
    }
}
