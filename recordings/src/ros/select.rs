//! Which topic plays which role.
//!
//! A topic named by the user, or by default `/cmd_vel` and `/odom`, is taken at its word: its type must fit. Only if a
//! default topic is not there, the single topic of the right type is taken instead, and the recording says so.

use wheelwright_core::recording::{ReadError, ReadOptions};

use super::collect::{Topic, malformed, same_topic};
use super::message::Kind;

/// A role that a topic can play.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Role {
    /// Commanded velocities.
    Cmd,
    /// Measured velocities and pose.
    Odom,
}

impl Role {
    fn option(self) -> &'static str {
        match self {
            Self::Cmd => "cmd",
            Self::Odom => "odom",
        }
    }

    fn default_topic(self) -> &'static str {
        match self {
            Self::Cmd => "/cmd_vel",
            Self::Odom => "/odom",
        }
    }

    fn kinds(self) -> &'static [Kind] {
        match self {
            Self::Cmd => &[Kind::Twist, Kind::TwistStamped],
            Self::Odom => &[Kind::Odometry],
        }
    }

    fn types(self) -> &'static str {
        match self {
            Self::Cmd => "geometry_msgs/Twist and geometry_msgs/TwistStamped",
            Self::Odom => "nav_msgs/Odometry",
        }
    }

    fn fits(self, topic: &Topic) -> bool {
        topic.message_kind().is_some_and(|kind| self.kinds().contains(&kind))
    }
}

/// The topic of a role, or none if neither the default nor any other of its type has messages.
///
/// # Errors
/// `Malformed` if a topic that the user named is not there or holds messages that do not decode, or if several could be
/// meant; `Unsupported` if its type, definition or encoding is not read.
pub(crate) fn select<'a>(
    role: Role,
    topics: &'a [Topic],
    options: &ReadOptions,
    warnings: &mut Vec<String>,
) -> Result<Option<&'a Topic>, ReadError> {
    let chosen = options.topics.iter().rev().find(|(r, _)| r == role.option()).map(|(_, topic)| topic.as_str());
    let wanted = chosen.unwrap_or(role.default_topic());
    let named = |t: &&Topic| same_topic(&t.name, wanted);
    let fitting = topics.iter().filter(named).find(|t| role.fits(t) && t.count > 0);
    if let Some(topic) = fitting.or_else(|| topics.iter().filter(named).find(|t| t.count > 0)) {
        return checked(role, topic).map(Some);
    }
    if chosen.is_some() {
        let state = if topics.iter().any(|t| named(&t)) { "has no messages" } else { "is not in the bag" };
        return Err(malformed(format!("topic `{wanted}`"), format!("{state}; {}", inventory(topics))));
    }
    let others: Vec<&Topic> = topics.iter().filter(|t| role.fits(t) && t.count > 0).collect();
    match others.as_slice() {
        [] => Ok(None),
        [only] => {
            warnings.push(format!("no messages on `{wanted}`: `{}`, the only topic of type {}, is used instead", only.name, only.kind));
            checked(role, only).map(Some)
        }
        several => {
            let names: Vec<&str> = several.iter().map(|t| t.name.as_str()).collect();
            let (hint, list) = (names[0], names.join(", "));
            Err(malformed(
                format!("topic `{wanted}`"),
                format!("has no messages, and several topics could be meant: {list}; choose one, as in --topic {}={hint}", role.option()),
            ))
        }
    }
}

/// Everything a bag holds, for messages.
pub(crate) fn inventory(topics: &[Topic]) -> String {
    if topics.is_empty() {
        return "the bag has no topics".to_owned();
    }
    let shown = topics.iter().take(40).map(|t| format!("{} ({}, {} messages)", t.name, t.kind, t.count));
    let more = topics.len().saturating_sub(40);
    let rest = if more > 0 { format!(" and {more} more") } else { String::new() };
    format!("the bag has {}{rest}", shown.collect::<Vec<_>>().join(", "))
}

fn checked(role: Role, topic: &Topic) -> Result<&Topic, ReadError> {
    let what = || format!("topic `{}`", topic.name);
    let unsupported = |reason: String| ReadError::Unsupported { what: what(), reason };
    if !role.fits(topic) {
        return Err(unsupported(format!(
            "its type is `{}`; read are {} (another topic: --topic {}=NAME)",
            topic.kind,
            role.types(),
            role.option()
        )));
    }
    if let Some(md5) = &topic.foreign_md5 {
        return Err(unsupported(format!("its definition of {} is not the standard one (MD5 {md5})", topic.kind)));
    }
    if !matches!(topic.encoding.as_str(), "cdr" | "ros1") {
        return Err(unsupported(format!("its messages are serialized as `{}`; read are cdr and ros1", topic.encoding)));
    }
    match &topic.fault {
        Some((number, error)) => Err(malformed(format!("topic `{}`, message {number}", topic.name), error)),
        None => Ok(topic),
    }
}
