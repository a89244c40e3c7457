//! A watchdog of the program itself: if the loop that feeds it hangs, it acts.

use std::sync::mpsc::{RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::time::Duration;

/// Acts once, on a thread of its own, when nobody has fed it for its limit; dropped before, it never acts.
#[derive(Debug)]
pub struct Watchdog(SyncSender<()>);

impl Watchdog {
    /// Starts watching. `act` is called at most once; for a driver that hangs all that is left is to end the program, so that the
    /// link goes down and the robot's own watchdog stops it.
    pub fn start(limit: Duration, act: impl FnOnce() + Send + 'static) -> Self {
        let (feed, fed) = sync_channel(1);
        std::thread::spawn(move || {
            loop {
                match fed.recv_timeout(limit) {
                    Ok(()) => {}
                    Err(RecvTimeoutError::Timeout) => return act(),
                    Err(RecvTimeoutError::Disconnected) => return,
                }
            }
        });
        Self(feed)
    }

    /// Says that the loop is alive. Never blocks.
    pub fn feed(&self) {
        // A full channel has been fed already; without a receiver it has acted.
        let (Ok(()) | Err(TrySendError::Full(()) | TrySendError::Disconnected(()))) = self.0.try_send(());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Arc;
    use std::sync::atomic::{AtomicUsize, Ordering};
    use std::thread::sleep;

    #[test]
    fn it_acts_once_when_it_is_not_fed_and_never_when_it_is_gone() {
        let acted = Arc::new(AtomicUsize::new(0));
        let count = |acted: &Arc<AtomicUsize>| {
            let acted = acted.clone();
            move || {
                acted.fetch_add(1, Ordering::SeqCst);
            }
        };
        let limit = Duration::from_millis(400);
        let dog = Watchdog::start(limit, count(&acted));
        for _ in 0..5 {
            sleep(limit / 4);
            dog.feed();
        }
        assert_eq!(acted.load(Ordering::SeqCst), 0);
        sleep(2 * limit);
        assert_eq!(acted.load(Ordering::SeqCst), 1);
        dog.feed();
        drop(Watchdog::start(limit / 4, count(&acted)));
        sleep(limit);
        assert_eq!(acted.load(Ordering::SeqCst), 1);
    }
}
