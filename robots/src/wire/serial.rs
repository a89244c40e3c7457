//! Serial lines and pseudo terminals, raw: eight bits, no parity, no flow control, no character with a meaning.

use std::fs::File;
use std::io::{Error, ErrorKind};
use std::os::fd::{AsFd, OwnedFd};
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::{Mode, OFlags};
use rustix::io::Errno;
use rustix::termios::{ControlModes, OptionalActions, QueueSelector, tcflush, tcgetattr, tcsetattr};
use wheelwright_core::robot::RobotError;

/// An open serial line.
#[derive(Debug)]
pub(crate) struct SerialPort {
    file: File,
}

impl SerialPort {
    /// Opens a device for this program alone; what was waiting to be read is thrown away.
    pub(crate) fn open(device: &str, baud: u32) -> Result<Self, RobotError> {
        let failed = |doing: &str, e: Errno| RobotError::Connection(format!("{device}: {doing}: {}", Error::from(e)));
        let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::NONBLOCK | OFlags::CLOEXEC;
        let fd = rustix::fs::open(device, flags, Mode::empty()).map_err(|e| failed("it cannot be opened", e))?;
        make_raw(&fd, baud).map_err(|e| failed(&format!("it cannot be set to {baud} bits a second"), e))?;
        // Two programs on one line would each get half of the answers.
        rustix::termios::ioctl_tiocexcl(&fd).map_err(|e| failed("it cannot be reserved", e))?;
        tcflush(&fd, QueueSelector::IOFlush).map_err(|e| failed("it cannot be flushed", e))?;
        Ok(Self { file: File::from(fd) })
    }

    pub(crate) fn read(&mut self, chunk: &mut [u8], wait: Duration) -> std::io::Result<usize> {
        read_within(&self.file, chunk, wait)
    }

    /// Waits until everything written is on the wire.
    pub(crate) fn finish(&mut self) {
        // A line that is gone has nothing to wait for.
        let _ = rustix::termios::tcdrain(&self.file);
    }

    pub(crate) fn write(&mut self, bytes: &[u8], limit: Duration) -> std::io::Result<()> {
        write_within(&self.file, bytes, limit)
    }
}

/// Sets a terminal to raw mode at a speed, without modem lines.
pub(crate) fn make_raw(fd: impl AsFd, baud: u32) -> Result<(), Errno> {
    let mut settings = tcgetattr(&fd)?;
    settings.make_raw();
    settings.control_modes |= ControlModes::CLOCAL | ControlModes::CREAD;
    settings.control_modes &= !ControlModes::CRTSCTS & !ControlModes::CSTOPB;
    settings.set_speed(baud)?;
    tcsetattr(&fd, OptionalActions::Now, &settings)
}

/// Reads what there is, waiting for it at most so long; 0 if nothing came.
pub(crate) fn read_within(fd: impl AsFd, chunk: &mut [u8], wait: Duration) -> std::io::Result<usize> {
    if !ready(&fd, PollFlags::IN, wait)? {
        return Ok(0);
    }
    match rustix::io::read(&fd, chunk) {
        Ok(0) => Err(ErrorKind::UnexpectedEof.into()),
        Err(Errno::AGAIN | Errno::INTR) => Ok(0),
        other => Ok(other?),
    }
}

/// Writes all of it within the limit.
pub(crate) fn write_within(fd: impl AsFd, mut bytes: &[u8], limit: Duration) -> std::io::Result<()> {
    let end = Instant::now() + limit;
    while !bytes.is_empty() {
        if !ready(&fd, PollFlags::OUT, end.saturating_duration_since(Instant::now()))? {
            return Err(ErrorKind::TimedOut.into());
        }
        match rustix::io::write(&fd, bytes) {
            Ok(count) => bytes = &bytes[count..],
            Err(Errno::AGAIN | Errno::INTR) => {}
            Err(error) => return Err(error.into()),
        }
    }
    Ok(())
}

fn ready(fd: &impl AsFd, flags: PollFlags, wait: Duration) -> std::io::Result<bool> {
    let timeout = Timespec::try_from(wait).map_err(|_| Error::from(ErrorKind::InvalidInput))?;
    let mut waiting = [PollFd::new(fd, flags)];
    match poll(&mut waiting, Some(&timeout)) {
        Ok(count) => Ok(count > 0),
        Err(Errno::INTR) => Ok(false),
        Err(error) => Err(error.into()),
    }
}

/// A new pseudo terminal: the master's end, the slave's end held open, and the slave's path.
///
/// As long as the slave's end is held, the master sees no hang-up when a program closes it, as on a cable.
pub(crate) fn pseudo_terminal(baud: u32) -> std::io::Result<(OwnedFd, OwnedFd, String)> {
    use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
    let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY)?;
    grantpt(&master)?;
    unlockpt(&master)?;
    let path = ptsname(&master, Vec::new())?.into_string().map_err(|_| Error::from(ErrorKind::InvalidData))?;
    let slave = rustix::fs::open(path.as_str(), OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC, Mode::empty())?;
    make_raw(&slave, baud)?;
    Ok((master, slave, path))
}
