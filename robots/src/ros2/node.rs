//! A node on the network: it joins, publishes, and reads with a limit of time.

use std::collections::BTreeSet;
use std::io::ErrorKind;
use std::time::{Duration, Instant};

use ros2_client::dds::rustdds::mio1::{Events, Interest, Poll, Token};
use ros2_client::dds::rustdds::{DomainParticipantBuilder, DomainParticipantStatusListener, GUID, RTPSEntity, StatusEvented};
use ros2_client::qos::History;
use ros2_client::{Context, MessageTypeName, Name, NodeName, NodeOptions, Publisher, QosProfile, ReadError, Subscription};
use wheelwright_core::robot::RobotError;

use super::Network;
use super::graph::{Endpoint, Graph};
use super::message::{Typed, type_name};

/// Messages kept for a reader that is busy.
const DEPTH: usize = 10;

/// A node that has joined.
pub(crate) struct Node {
    node: ros2_client::Node,
    context: Context,
    events: DomainParticipantStatusListener,
    graph: Graph,
}

impl Node {
    /// Joins a network under a name.
    pub(crate) fn join(network: &Network, name: &str) -> Result<Self, RobotError> {
        let mut participant = DomainParticipantBuilder::new(network.domain);
        if !network.interfaces.is_empty() {
            participant = participant.with_only_networks(network.interfaces.iter().copied());
        }
        let participant = participant.build().map_err(|e| failed("the network cannot be joined", e))?;
        let events = participant.status_listener();
        let context = Context::from_domain_participant(participant).map_err(|e| failed("the network cannot be joined", e))?;
        let name = NodeName::new("/", name).map_err(|e| RobotError::Driver(e.to_string()))?;
        let options = NodeOptions::new().enable_rosout(false).start_parameter_services(false);
        let node = context.new_node(name, options).map_err(|e| failed("the node cannot be made", e))?;
        Ok(Self { node, context, events, graph: Graph::default() })
    }

    /// What discovery has told until now.
    pub(crate) fn graph(&mut self) -> &Graph {
        while let Some(event) = self.events.try_recv_status() {
            self.graph.note(event);
        }
        &self.graph
    }

    /// What others subscribe.
    pub(crate) fn subscribed(&self) -> Vec<Endpoint> {
        let participant = self.context.domain_participant();
        let readers = participant.discovered_readers().into_iter().map(|r| r.subscription_topic_data);
        let others = readers.filter(|r| r.key().prefix != participant.guid().prefix);
        others.filter_map(|r| Endpoint::of_wire(r.topic_name(), r.type_name(), r.key())).collect()
    }

    /// What others publish.
    pub(crate) fn published(&self) -> Vec<Endpoint> {
        let participant = self.context.domain_participant();
        let writers = participant.discovered_writers().into_iter().map(|w| w.publication_topic_data);
        let others = writers.filter(|w| w.key.prefix != participant.guid().prefix);
        others.filter_map(|w| Endpoint::of_wire(&w.topic_name, &w.type_name, w.key)).collect()
    }

    /// Subscribers of others that a writer of ours reaches.
    pub(crate) fn listeners<M: Typed>(&mut self, writer: &Writer<M>) -> BTreeSet<GUID> {
        let subscribed = self.subscribed();
        self.graph().partners(writer.id(), fitting::<M>(subscribed, &writer.topic))
    }

    /// Publishers of others that reach a reader of ours.
    pub(crate) fn tellers<M: Typed>(&mut self, reader: &Reader<M>) -> BTreeSet<GUID> {
        let published = self.published();
        self.graph().partners(reader.id(), fitting::<M>(published, &reader.topic))
    }

    /// A publisher that sends again what was lost, which fits every subscriber.
    pub(crate) fn writer<M: Typed>(&mut self, topic: &str) -> Result<Writer<M>, RobotError> {
        let quality = QosProfile::publisher_default();
        let place = self.topic::<M>(topic, &quality)?;
        let publisher = self.node.create_publisher(&place, Some(quality)).map_err(|e| failed(topic, e))?;
        Ok(Writer { publisher, topic: topic.to_owned() })
    }

    /// A subscription that lets lost messages go, which fits every publisher.
    pub(crate) fn reader<M: Typed>(&mut self, topic: &str) -> Result<Reader<M>, RobotError> {
        self.read(topic, QosProfile::subscription_default())
    }

    /// A subscription that wants every message, as robots subscribe their commands; publishers that let messages go do not fit.
    pub(crate) fn reliable_reader<M: Typed>(&mut self, topic: &str) -> Result<Reader<M>, RobotError> {
        self.read(topic, QosProfile::publisher_default())
    }

    fn read<M: Typed>(&mut self, topic: &str, quality: QosProfile) -> Result<Reader<M>, RobotError> {
        let quality = quality.history(History::KeepLast { depth: DEPTH });
        let place = self.topic::<M>(topic, &quality)?;
        let mut subscription = self.node.create_subscription(&place, Some(quality)).map_err(|e| failed(topic, e))?;
        let poll = Poll::new().map_err(|e| failed(topic, e))?;
        poll.registry().register(&mut subscription, Token(0), Interest::READABLE).map_err(|e| failed(topic, e))?;
        Ok(Reader { subscription, poll, events: Events::with_capacity(8), topic: topic.to_owned() })
    }

    fn topic<M: Typed>(&self, topic: &str, quality: &QosProfile) -> Result<ros2_client::dds::rustdds::Topic, RobotError> {
        let (package, name) = M::TYPE;
        let place = Name::parse(topic).map_err(|e| failed(topic, e))?;
        self.node.create_topic(&place, MessageTypeName::new(package, name), quality).map_err(|e| failed(topic, e))
    }
}

/// Those of a topic and a type.
fn fitting<M: Typed>(endpoints: Vec<Endpoint>, topic: &str) -> impl Iterator<Item = GUID> {
    let kind = type_name::<M>();
    endpoints.into_iter().filter(move |e| e.topic == topic && e.kind == kind).map(|e| e.id)
}

fn failed(what: &str, error: impl std::fmt::Display) -> RobotError {
    RobotError::Connection(format!("{what}: {error}"))
}

/// Publishes on a topic.
pub(crate) struct Writer<M: Typed> {
    publisher: Publisher<M>,
    topic: String,
}

impl<M: Typed> Writer<M> {
    /// Sends one message.
    pub(crate) fn send(&self, message: M) -> Result<(), RobotError> {
        self.publisher.publish(message).map_err(|e| failed(&format!("publishing on {}", self.topic), e))
    }

    /// Its name on the network.
    pub(crate) fn id(&self) -> GUID {
        self.publisher.guid()
    }
}

/// Reads from a topic.
pub(crate) struct Reader<M: Typed> {
    subscription: Subscription<M>,
    poll: Poll,
    events: Events,
    topic: String,
}

impl<M: Typed> Reader<M> {
    /// The next message; `None` if none comes in time. What has come already is always taken; what cannot be read, as the message
    /// of a publisher of another type, is passed over.
    pub(crate) fn receive(&mut self, until: Instant) -> Result<Option<M>, RobotError> {
        loop {
            let taken = match self.subscription.take() {
                Err(ReadError::Deserialization { .. }) => continue,
                taken => taken.map_err(|e| RobotError::Driver(format!("reading {}: {e}", self.topic)))?,
            };
            let left = until.saturating_duration_since(Instant::now());
            if taken.is_some() || left.is_zero() {
                return Ok(taken.map(|(message, _)| message));
            }
            self.wait(left)?;
        }
    }

    /// Until something happens, at most so long.
    fn wait(&mut self, longest: Duration) -> Result<(), RobotError> {
        match self.poll.poll(&mut self.events, Some(longest)) {
            Err(error) if error.kind() != ErrorKind::Interrupted => Err(failed(&format!("waiting for {}", self.topic), error)),
            _ => Ok(()),
        }
    }

    /// Its name on the network.
    pub(crate) fn id(&self) -> GUID {
        self.subscription.guid()
    }
}
