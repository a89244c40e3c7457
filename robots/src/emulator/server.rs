//! Serving a protocol: one thread that owns it, threads that read, and a clock.

use std::any::Any;
use std::collections::VecDeque;
use std::io::{ErrorKind, Read, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use wheelwright_core::robot::RobotError;

use super::{Clock, Protocol};

/// How often a waiting thread looks whether it is to end.
const LOOK: Duration = Duration::from_millis(20);
/// A client that takes no byte for this long is gone.
const WRITE_LIMIT: Duration = Duration::from_secs(1);
/// Commands kept for [`Emulator::commands`].
const MOST_COMMANDS: usize = 100_000;
/// A clock that is further behind starts again: the machine was asleep.
const FAR_BEHIND: Duration = Duration::from_secs(1);

/// Where a protocol is served.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Place {
    /// `host:port`
    Tcp(String),
    /// A pseudo terminal, with a link to it at this path.
    #[cfg_attr(not(unix), allow(dead_code))]
    Pty(std::path::PathBuf),
}

/// What an emulated robot is doing.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct State {
    /// The robot's time \[s\].
    pub time: f64,
    /// A session is open.
    pub open: bool,
    /// The motors are powered.
    pub enabled: bool,
    /// Commanded velocity \[m/s\].
    pub v_ref: f64,
    /// Commanded angular velocity \[rad/s\].
    pub omega_ref: f64,
    /// Velocity \[m/s\].
    pub v: f64,
    /// Angular velocity \[rad/s\].
    pub omega: f64,
}

/// A command as it reached the robot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Command {
    /// When it arrived, on this machine's clock.
    pub arrival: Instant,
    /// The robot's state with it.
    pub state: State,
}

/// A running emulator; it ends when this goes.
pub struct Emulator {
    address: String,
    board: Board,
    serving: Option<JoinHandle<Result<(), RobotError>>>,
    /// Removes the link to a terminal.
    _link: Option<Box<dyn Any + Send + Sync>>,
}

/// What is seen of an emulator from outside, and how it is told to end.
#[derive(Clone)]
pub(super) struct Board {
    stop: Arc<AtomicBool>,
    shared: Arc<Mutex<Shared>>,
}

#[derive(Default)]
struct Shared {
    state: State,
    commands: VecDeque<Command>,
    clients: u64,
}

impl Board {
    pub(super) fn new(state: State) -> Self {
        let shared = Shared { state, ..Shared::default() };
        Self { stop: Arc::new(AtomicBool::new(false)), shared: Arc::new(Mutex::new(shared)) }
    }

    /// The emulator is to end.
    pub(super) fn ends(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    /// One more client.
    pub(super) fn count_client(&self) {
        self.lock().clients += 1;
    }

    /// Shows the state; a command that changed is kept with its time.
    pub(super) fn publish(&self, state: State, commanded: bool) {
        let mut shared = self.lock();
        let key = |s: &State| (s.v_ref, s.omega_ref, s.enabled, s.open);
        if commanded && shared.commands.back().map(|c| key(&c.state)) != Some(key(&state)) {
            if shared.commands.len() == MOST_COMMANDS {
                shared.commands.pop_front();
            }
            shared.commands.push_back(Command { arrival: Instant::now(), state });
        }
        shared.state = state;
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, Shared> {
        self.shared.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Emulator {
    pub(super) fn start(place: &Place, clock: Clock, protocol: Box<dyn Protocol>) -> Result<Self, RobotError> {
        let board = Board::new(protocol.state());
        let stop = &board.stop;
        let (events, inbox) = channel();
        let (address, link): (String, Option<Box<dyn Any + Send + Sync>>) = match place {
            Place::Tcp(address) => (listen(address, stop, events)?, None),
            #[cfg(unix)]
            Place::Pty(path) => {
                let link = terminal::open(path, stop, events)?;
                (path.display().to_string(), Some(Box::new(link)))
            }
            #[cfg(not(unix))]
            Place::Pty(_) => return Err(crate::wire::config("pty", "pseudo terminals are not supported on this system; use `listen`")),
        };
        let server = Server { protocol, clock, inbox, board: board.clone(), client: None };
        Ok(Self::run(address, board, link, move || server.serve()))
    }

    /// An emulator that is served on a thread of its own, which shows on the board what the robot does and ends when told there.
    pub(super) fn run(
        address: String,
        board: Board,
        link: Option<Box<dyn Any + Send + Sync>>,
        serve: impl FnOnce() -> Result<(), RobotError> + Send + 'static,
    ) -> Self {
        Self { address, board, serving: Some(std::thread::spawn(serve)), _link: link }
    }

    /// Where it is: `host:port`, the terminal's path, or the domain and its topics.
    pub fn address(&self) -> &str {
        &self.address
    }

    /// What the robot is doing.
    pub fn state(&self) -> State {
        self.board.lock().state
    }

    /// Every change of what was commanded, the first one first.
    pub fn commands(&self) -> Vec<Command> {
        self.board.lock().commands.iter().copied().collect()
    }

    /// Clients so far.
    pub fn clients(&self) -> u64 {
        self.board.lock().clients
    }

    /// False once the robot behind it has failed.
    pub fn is_running(&self) -> bool {
        self.serving.as_ref().is_some_and(|thread| !thread.is_finished())
    }

    /// Ends it.
    ///
    /// # Errors
    /// [`RobotError`] that ended it before.
    pub fn finish(mut self) -> Result<(), RobotError> {
        self.end()
    }

    fn end(&mut self) -> Result<(), RobotError> {
        self.board.stop.store(true, Ordering::Relaxed);
        match self.serving.take().map(JoinHandle::join) {
            None => Ok(()),
            Some(Ok(outcome)) => outcome,
            Some(Err(_)) => Err(RobotError::Driver("the emulator's thread panicked".to_owned())),
        }
    }
}

impl Drop for Emulator {
    fn drop(&mut self) {
        let _ = self.end();
    }
}

/// What the reading threads have to say.
enum Event {
    Connected(Box<dyn Client>),
    Bytes(Vec<u8>),
    Gone,
}

/// The way back to a client.
trait Client: Send {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<()>;
    /// Cuts the line.
    fn cut(&mut self);
}

impl Client for TcpStream {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<()> {
        self.write_all(bytes)
    }

    fn cut(&mut self) {
        let _ = self.shutdown(Shutdown::Both);
    }
}

/// The thread that owns the protocol.
struct Server {
    protocol: Box<dyn Protocol>,
    clock: Clock,
    inbox: Receiver<Event>,
    board: Board,
    client: Option<Box<dyn Client>>,
}

impl Server {
    fn serve(mut self) -> Result<(), RobotError> {
        let period = Duration::from_secs_f64(self.protocol.period());
        let mut due = Instant::now() + period;
        let mut answers = Vec::new();
        while !self.board.ends() {
            let wait = match self.clock {
                Clock::Real => due.saturating_duration_since(Instant::now()).min(LOOK),
                Clock::Stepped => LOOK,
            };
            match self.inbox.recv_timeout(wait) {
                Ok(event) => self.handle(event, &mut answers)?,
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => break,
            }
            while self.clock == Clock::Real && Instant::now() >= due {
                self.protocol.pass(&mut answers)?;
                self.send(&mut answers);
                due += period;
                if due + FAR_BEHIND < Instant::now() {
                    due = Instant::now() + period;
                }
            }
            self.board.publish(self.protocol.state(), false);
        }
        Ok(())
    }

    fn handle(&mut self, event: Event, answers: &mut Vec<u8>) -> Result<(), RobotError> {
        match event {
            Event::Connected(client) => {
                self.client = Some(client);
                self.board.count_client();
            }
            // The robot does not notice: its watchdog does.
            Event::Gone => self.client = None,
            Event::Bytes(bytes) => {
                self.protocol.receive(&bytes, answers)?;
                self.board.publish(self.protocol.state(), true);
                self.send(answers);
            }
        }
        Ok(())
    }

    fn send(&mut self, answers: &mut Vec<u8>) {
        if let Some(client) = &mut self.client {
            let sent = answers.is_empty() || client.write(answers).is_ok();
            if self.protocol.cuts_line() {
                client.cut();
            }
            if !sent {
                self.client = None;
            }
        }
        answers.clear();
    }
}

/// Listens; one client at a time, as on a serial line.
fn listen(address: &str, stop: &Arc<AtomicBool>, events: Sender<Event>) -> Result<String, RobotError> {
    let failed = |e: std::io::Error| RobotError::Connection(format!("{address} cannot be served: {e}"));
    let listener = TcpListener::bind(address).map_err(failed)?;
    listener.set_nonblocking(true).map_err(failed)?;
    let bound = listener.local_addr().map_err(failed)?.to_string();
    let stop = Arc::clone(stop);
    std::thread::spawn(move || {
        while !stop.load(Ordering::Relaxed) {
            match listener.accept() {
                Ok((stream, _)) => {
                    if attend(stream, &stop, &events).is_none() {
                        return;
                    }
                }
                Err(_) => std::thread::sleep(LOOK / 4),
            }
        }
    });
    Ok(bound)
}

/// Reads from a client until it goes; `None` if nobody listens to the events any more.
fn attend(stream: TcpStream, stop: &AtomicBool, events: &Sender<Event>) -> Option<()> {
    let ready = stream
        .set_nonblocking(false)
        .and_then(|()| stream.set_nodelay(true))
        .and_then(|()| stream.set_read_timeout(Some(LOOK)))
        .and_then(|()| stream.set_write_timeout(Some(WRITE_LIMIT)))
        .and_then(|()| stream.try_clone());
    let Ok(back) = ready else { return Some(()) };
    events.send(Event::Connected(Box::new(back))).ok()?;
    let mut stream = stream;
    let mut chunk = [0_u8; 4096];
    while !stop.load(Ordering::Relaxed) {
        match stream.read(&mut chunk) {
            Ok(0) => break,
            Ok(count) => events.send(Event::Bytes(chunk[..count].to_vec())).ok()?,
            Err(e) if matches!(e.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted) => {}
            Err(_) => break,
        }
    }
    events.send(Event::Gone).ok()
}

/// Serving on a pseudo terminal.
#[cfg(unix)]
mod terminal {
    use std::fs::File;
    use std::os::fd::OwnedFd;
    use std::path::{Path, PathBuf};
    use std::sync::Arc;
    use std::sync::atomic::{AtomicBool, Ordering};
    use std::sync::mpsc::Sender;

    use wheelwright_core::robot::RobotError;

    use super::{Client, Event, LOOK, WRITE_LIMIT};
    use crate::wire::config;
    use crate::wire::serial::{pseudo_terminal, read_within, write_within};

    /// Makes the terminal, links to it at `path`, and reads from it.
    pub(super) fn open(path: &Path, stop: &Arc<AtomicBool>, events: Sender<Event>) -> Result<Link, RobotError> {
        let failed = |e: std::io::Error| RobotError::Connection(format!("{}: no pseudo terminal: {e}", path.display()));
        let (master, slave, device) = pseudo_terminal(115_200).map_err(failed)?;
        let link = Link::new(path, Path::new(&device))?;
        let master = File::from(master);
        let back = Terminal { master: master.try_clone().map_err(failed)?, _slave: slave };
        events.send(Event::Connected(Box::new(back))).map_err(|_| RobotError::Driver("the emulator ended".to_owned()))?;
        let stop = Arc::clone(stop);
        std::thread::spawn(move || {
            let mut chunk = [0_u8; 4096];
            while !stop.load(Ordering::Relaxed) {
                match read_within(&master, &mut chunk, LOOK) {
                    Ok(0) => {}
                    Ok(count) => {
                        if events.send(Event::Bytes(chunk[..count].to_vec())).is_err() {
                            return;
                        }
                    }
                    Err(_) => return,
                }
            }
        });
        Ok(link)
    }

    struct Terminal {
        master: File,
        /// Held, so that the terminal lives on when a client closes it.
        _slave: OwnedFd,
    }

    impl Client for Terminal {
        fn write(&mut self, bytes: &[u8]) -> std::io::Result<()> {
            write_within(&self.master, bytes, WRITE_LIMIT)
        }

        /// A cable cannot be cut from here; the client hears nothing more.
        fn cut(&mut self) {}
    }

    /// A link to a terminal, removed at the end.
    pub(super) struct Link(PathBuf);

    impl Link {
        fn new(path: &Path, device: &Path) -> Result<Self, RobotError> {
            match std::fs::symlink_metadata(path) {
                // Left by an emulator that was killed.
                Ok(existing) if existing.is_symlink() => {
                    let _ = std::fs::remove_file(path);
                }
                Ok(_) => return Err(config("pty", format!("{} exists and is no link: choose another path", path.display()))),
                Err(_) => {}
            }
            std::os::unix::fs::symlink(device, path)
                .map_err(|e| RobotError::Connection(format!("{}: the link to the terminal cannot be made: {e}", path.display())))?;
            Ok(Self(path.to_owned()))
        }
    }

    impl Drop for Link {
        fn drop(&mut self) {
            let _ = std::fs::remove_file(&self.0);
        }
    }
}
