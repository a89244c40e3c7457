//! Who else is on the network: which endpoints found each other, and why the others did not.
//!
//! Endpoints of DDS that do not fit stay silent on both sides. What discovery tells is therefore put into words here.

use std::collections::{BTreeMap, BTreeSet};

use ros2_client::dds::rustdds::qos::QosPolicyId;
use ros2_client::dds::rustdds::{DomainParticipantStatusEvent as Event, GUID};

use super::message::{Odometry, type_name};
use super::{CommandType, Network};

/// Topics named in one sentence.
const MOST_NAMED: usize = 6;

/// What the events of discovery said so far.
#[derive(Debug, Default)]
pub(crate) struct Graph {
    programs: BTreeSet<GUID>,
    /// Endpoints of others that found one of ours.
    partners: BTreeMap<GUID, BTreeSet<GUID>>,
    /// What an endpoint of another asks for that ours does not have, by our endpoint.
    refusals: BTreeMap<GUID, QosPolicyId>,
}

impl Graph {
    /// Takes one event.
    pub(crate) fn note(&mut self, event: Event) {
        match event {
            Event::ParticipantDiscovered { dpd } => drop(self.programs.insert(dpd.guid)),
            Event::ParticipantLost { id, .. } => {
                self.programs.retain(|program| program.prefix != id);
                self.lose(|endpoint| endpoint.prefix == id);
            }
            Event::ReaderLost { guid, .. } | Event::WriterLost { guid, .. } => self.lose(|endpoint| *endpoint == guid),
            Event::RemoteReaderMatched { local_writer: own, remote_reader: other }
            | Event::RemoteWriterMatched { local_reader: own, remote_writer: other } => {
                self.partners.entry(own).or_default().insert(other);
            }
            Event::RemoteReaderQosIncompatible { local_writer: own, requested_qos, offered_qos, .. }
            | Event::RemoteWriterQosIncompatible { local_reader: own, requested_qos, offered_qos, .. } => {
                self.refusals.extend(offered_qos.compliance_failure_wrt(&requested_qos).map(|policy| (own, policy)));
            }
            _ => {}
        }
    }

    fn lose(&mut self, lost: impl Fn(&GUID) -> bool) {
        for others in self.partners.values_mut() {
            others.retain(|other| !lost(other));
        }
    }

    /// Those of the given endpoints that found this one of ours. Matching alone does not ask for the type, so that the caller must.
    pub(crate) fn partners(&self, own: GUID, among: impl IntoIterator<Item = GUID>) -> BTreeSet<GUID> {
        let found = self.partners.get(&own);
        among.into_iter().filter(|other| found.is_some_and(|found| found.contains(other))).collect()
    }

    /// What kept an endpoint from finding this one of ours, as the name of a quality of service.
    pub(crate) fn refusal(&self, own: GUID) -> Option<String> {
        self.refusals.get(&own).map(|policy| format!("{policy:?}").to_lowercase())
    }

    /// Programs of others, `own` being one of our endpoints.
    pub(crate) fn programs_beside(&self, own: GUID) -> usize {
        self.programs.iter().filter(|program| program.prefix != own.prefix).count()
    }
}

/// What somebody subscribes or publishes, as ROS 2 writes it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Endpoint {
    pub topic: String,
    pub kind: String,
    pub id: GUID,
}

impl Endpoint {
    /// From the names on the wire: `rt/cmd_vel`, `geometry_msgs::msg::dds_::Twist_`. `None` for what is no topic of ROS 2.
    pub(crate) fn of_wire(topic: &str, kind: &str, id: GUID) -> Option<Self> {
        let topic = topic.strip_prefix("rt").filter(|topic| topic.starts_with('/'))?.to_owned();
        let kind = kind.replace("::dds_::", "::").replace("::", "/");
        Some(Self { topic, kind: kind.trim_end_matches('_').to_owned(), id })
    }
}

/// Which messages for commands are subscribed on a topic.
pub(crate) fn command_types(subscribed: &[Endpoint], topic: &str) -> Vec<CommandType> {
    let subscribed = |kind: &CommandType| subscribed.iter().any(|e| e.topic == topic && e.kind == kind.name());
    [CommandType::Twist, CommandType::TwistStamped].into_iter().filter(subscribed).collect()
}

/// One direction between this program and the robot, as far as it came.
#[derive(Debug)]
pub(crate) struct Direction<'a> {
    /// What is done on the robot's side: "subscribes", "publishes".
    pub verb: &'a str,
    /// Key of the topic in the configuration.
    pub key: &'a str,
    /// The topic.
    pub topic: &'a str,
    /// Types that fit.
    pub fitting: Vec<String>,
    /// All endpoints there are.
    pub endpoints: &'a [Endpoint],
    /// The quality of service that did not fit.
    pub refusal: Option<String>,
}

impl Direction<'_> {
    /// What to do about a direction that did not come about.
    pub(crate) fn complaint(&self) -> String {
        let Self { verb, key, topic, .. } = self;
        let here: BTreeSet<&str> = self.endpoints.iter().filter(|e| e.topic == *topic).map(|e| e.kind.as_str()).collect();
        if here.is_empty() {
            let elsewhere = self.topics(|e| self.fitting.contains(&e.kind));
            return if elsewhere.is_empty() {
                format!("nobody {verb} {topic}: is the robot's driver running? What is there: {}", self.topics(|_| true).or_nothing())
            } else {
                format!("nobody {verb} {topic}, but there is {elsewhere}: set `{key}`")
            };
        }
        let fitting = self.fitting.join(" or ");
        if !self.fitting.iter().any(|kind| here.contains(kind.as_str())) {
            let types: Vec<_> = here.into_iter().collect();
            return format!("the robot {verb} {topic} as {}, not as {fitting}{}", types.join(" and "), command_hint(&types));
        }
        match &self.refusal {
            Some(policy) => format!("the robot {verb} {topic} with a quality of service that does not fit: {policy}"),
            None => {
                format!("the robot {verb} {topic} as {fitting}, but the two ends did not find each other: does a firewall hold back UDP?")
            }
        }
    }

    /// Names of topics, the first few.
    fn topics(&self, wanted: impl Fn(&Endpoint) -> bool) -> Names {
        Names(self.endpoints.iter().filter(|e| wanted(e)).map(|e| e.topic.clone()).collect())
    }
}

/// Where the type is another one for commands, the configuration was wrong and not the robot.
fn command_hint(types: &[&str]) -> &'static str {
    let known = |kind: CommandType| types.contains(&kind.name().as_str());
    if known(CommandType::Twist) || known(CommandType::TwistStamped) { ": leave `command_type` out" } else { "" }
}

/// A set of topics in a sentence.
struct Names(BTreeSet<String>);

impl Names {
    fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    fn or_nothing(&self) -> String {
        if self.is_empty() { "nothing".to_owned() } else { self.to_string() }
    }
}

impl std::fmt::Display for Names {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let named: Vec<_> = self.0.iter().take(MOST_NAMED).map(String::as_str).collect();
        let more = self.0.len() - named.len();
        write!(f, "{}", named.join(", "))?;
        if more > 0 { write!(f, " and {more} more") } else { Ok(()) }
    }
}

/// Types that fit the commands.
pub(crate) fn fitting_commands(wanted: Option<CommandType>) -> Vec<String> {
    wanted.map_or_else(|| vec![CommandType::Twist.name(), CommandType::TwistStamped.name()], |kind| vec![kind.name()])
}

/// Types that fit the odometry.
pub(crate) fn fitting_odometry() -> Vec<String> {
    vec![type_name::<Odometry>()]
}

/// What to do where nobody was found at all.
pub(crate) fn alone(network: &Network) -> String {
    let domain = network.domain;
    format!(
        "no other ROS 2 program is seen in {network}: is the robot on, is its ROS_DOMAIN_ID {domain}, does it use DDS (not rmw_zenoh) and not only \
         its own host (ROS_LOCALHOST_ONLY, ROS_AUTOMATIC_DISCOVERY_RANGE), and does the network pass multicast? Many containers and wireless \
         networks do not; `interfaces` picks another one"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn endpoint(topic: &str, kind: &str) -> Endpoint {
        Endpoint { topic: topic.to_owned(), kind: kind.to_owned(), id: GUID::GUID_UNKNOWN }
    }

    fn commands<'a>(endpoints: &'a [Endpoint], wanted: Option<CommandType>, refusal: Option<&str>) -> Direction<'a> {
        let fitting = fitting_commands(wanted);
        Direction { verb: "subscribes", key: "command_topic", topic: "/cmd_vel", fitting, endpoints, refusal: refusal.map(str::to_owned) }
    }

    #[test]
    fn names_of_the_wire_are_those_of_ros() {
        let found = Endpoint::of_wire("rt/robot/cmd_vel", "geometry_msgs::msg::dds_::TwistStamped_", GUID::GUID_UNKNOWN);
        assert_eq!(found, Some(endpoint("/robot/cmd_vel", "geometry_msgs/msg/TwistStamped")));
        assert_eq!(
            Endpoint::of_wire("ros_discovery_info", "rmw_dds_common::msg::dds_::ParticipantEntitiesInfo_", GUID::GUID_UNKNOWN),
            None
        );
    }

    #[test]
    fn each_silent_mismatch_has_words_of_its_own() {
        let twist = "geometry_msgs/msg/Twist";
        let stamped = "geometry_msgs/msg/TwistStamped";
        let cases = [
            (vec![], None, None, "is the robot's driver running? What is there: nothing"),
            (vec![endpoint("/parameter_events", "x")], None, None, "What is there: /parameter_events"),
            (vec![endpoint("/base/cmd_vel", stamped)], None, None, "but there is /base/cmd_vel: set `command_topic`"),
            (
                vec![endpoint("/cmd_vel", stamped)],
                Some(CommandType::Twist),
                None,
                "not as geometry_msgs/msg/Twist: leave `command_type` out",
            ),
            (vec![endpoint("/cmd_vel", "std_msgs/msg/String")], None, None, "as std_msgs/msg/String, not as geometry_msgs/msg/Twist or"),
            (vec![endpoint("/cmd_vel", twist)], None, Some("durability"), "a quality of service that does not fit: durability"),
            (vec![endpoint("/cmd_vel", twist)], None, None, "does a firewall hold back UDP?"),
        ];
        for (endpoints, wanted, refusal, expected) in cases {
            let words = commands(&endpoints, wanted, refusal).complaint();
            assert!(words.contains(expected), "{expected}: {words}");
        }
        assert!(alone(&Network { domain: 7, interfaces: vec![[10, 0, 0, 1].into()] }).contains("domain 7 on 10.0.0.1"));
    }

    #[test]
    fn the_type_of_commands_is_what_is_subscribed() {
        let subscribed = [endpoint("/cmd_vel", "geometry_msgs/msg/TwistStamped"), endpoint("/other", "geometry_msgs/msg/Twist")];
        assert_eq!(command_types(&subscribed, "/cmd_vel"), [CommandType::TwistStamped]);
        assert_eq!(command_types(&subscribed, "/none"), []);
    }
}
