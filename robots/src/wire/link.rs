//! A byte stream to a robot.

use std::io::{ErrorKind, Write};
use std::net::{Shutdown, TcpStream, ToSocketAddrs};
use std::time::{Duration, Instant};

use wheelwright_core::robot::RobotError;

use super::config;
#[cfg(unix)]
use super::serial::SerialPort;

/// A peer that takes no byte for this long is gone.
const WRITE_LIMIT: Duration = Duration::from_secs(1);
const CONNECT_LIMIT: Duration = Duration::from_secs(3);
/// How long the other end may take to hear the last words.
const LAST_WORDS: Duration = Duration::from_millis(200);

/// Where the robot is.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Endpoint {
    /// `host:port`
    Tcp(String),
    /// Device and bits a second.
    Serial(String, u32),
}

impl Endpoint {
    /// Exactly one of `tcp` and `serial`.
    pub(crate) fn new(tcp: Option<&str>, serial: Option<&str>, baud: u32) -> Result<Self, RobotError> {
        match (tcp, serial) {
            (Some(address), None) => Ok(Self::Tcp(address.to_owned())),
            (None, Some(device)) => Ok(Self::Serial(device.to_owned(), baud)),
            (Some(_), Some(_)) => Err(config("serial", "stands beside `tcp`: keep the one the robot is connected by")),
            (None, None) => Err(config("tcp", "is missing: tcp = \"host:port\", or serial = \"/dev/ttyUSB0\"")),
        }
    }
}

/// An open stream.
#[derive(Debug)]
pub(crate) enum Link {
    Tcp(TcpStream),
    #[cfg(unix)]
    Serial(SerialPort),
}

impl Link {
    pub(crate) fn open(endpoint: &Endpoint) -> Result<Self, RobotError> {
        match endpoint {
            Endpoint::Tcp(address) => connect(address).map(Self::Tcp),
            #[cfg(unix)]
            Endpoint::Serial(device, baud) => SerialPort::open(device, *baud).map(Self::Serial),
            #[cfg(not(unix))]
            Endpoint::Serial(..) => Err(config("serial", "serial lines are not supported on this system; use a TCP bridge and `tcp`")),
        }
    }

    /// Writes all of it.
    pub(crate) fn send(&mut self, bytes: &[u8]) -> Result<(), RobotError> {
        match self {
            Self::Tcp(stream) => stream.write_all(bytes).map_err(|e| lost("writing", &e)),
            #[cfg(unix)]
            Self::Serial(port) => port.write(bytes, WRITE_LIMIT).map_err(|e| lost("writing", &e)),
        }
    }

    /// Sees to it that what was sent last arrives. A socket that is closed with bytes unread takes back what is on its way.
    pub(crate) fn finish(&mut self) {
        match self {
            Self::Tcp(stream) => {
                let end = Instant::now() + LAST_WORDS;
                let mut unread = [0_u8; 4096];
                let _ = stream.shutdown(Shutdown::Write);
                while Instant::now() < end && read_tcp(stream, &mut unread, LAST_WORDS / 4).is_ok() {}
            }
            #[cfg(unix)]
            Self::Serial(port) => port.finish(),
        }
    }

    /// Waits for bytes and appends what has come; 0 if nothing came in time.
    pub(crate) fn receive(&mut self, buffer: &mut Vec<u8>, wait: Duration) -> Result<usize, RobotError> {
        let mut chunk = [0_u8; 4096];
        let read = match self {
            Self::Tcp(stream) => read_tcp(stream, &mut chunk, wait),
            #[cfg(unix)]
            Self::Serial(port) => port.read(&mut chunk, wait),
        };
        let count = read.map_err(|e| lost("reading", &e))?;
        buffer.extend_from_slice(&chunk[..count]);
        Ok(count)
    }
}

fn connect(address: &str) -> Result<TcpStream, RobotError> {
    let unknown = |e: std::io::Error| RobotError::Connection(format!("{address}: {e}; expected host:port of a robot or a serial bridge"));
    let mut last = None;
    for target in address.to_socket_addrs().map_err(unknown)? {
        match TcpStream::connect_timeout(&target, CONNECT_LIMIT) {
            Ok(stream) => {
                // Commands are small and late ones are worthless: none may wait to be sent with the next.
                let set = stream.set_nodelay(true).and_then(|()| stream.set_write_timeout(Some(WRITE_LIMIT)));
                return set.map(|()| stream).map_err(|e| lost("setting up the socket", &e));
            }
            Err(error) => last = Some(error),
        }
    }
    Err(RobotError::Connection(
        last.map_or_else(|| format!("{address} is no address"), |e| format!("{address}: {e}; is the robot on and listening?")),
    ))
}

#[cfg(unix)]
fn read_tcp(stream: &mut TcpStream, chunk: &mut [u8], wait: Duration) -> std::io::Result<usize> {
    super::serial::read_within(&*stream, chunk, wait)
}

/// A socket's own timeout, which is coarser than a poll.
#[cfg(not(unix))]
fn read_tcp(stream: &mut TcpStream, chunk: &mut [u8], wait: Duration) -> std::io::Result<usize> {
    use std::io::Read;
    stream.set_read_timeout(Some(wait.max(Duration::from_micros(1))))?;
    match stream.read(chunk) {
        Ok(0) => Err(ErrorKind::UnexpectedEof.into()),
        Err(e) if matches!(e.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted) => Ok(0),
        other => other,
    }
}

fn lost(doing: &str, error: &std::io::Error) -> RobotError {
    match error.kind() {
        ErrorKind::UnexpectedEof => RobotError::Connection("the other end closed it".to_owned()),
        _ => RobotError::Connection(format!("{doing}: {error}")),
    }
}
