//! A wire that can be cut, broken and made slow: connections to it go on to another address.

use std::io::{Read, Write};
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::Duration;

/// The wire.
#[derive(Clone, Debug)]
pub(crate) struct Proxy {
    pub(crate) port: u16,
    /// What is sent waits.
    is_cut: Arc<AtomicBool>,
    /// What is answered waits.
    is_deaf: Arc<AtomicBool>,
    is_broken: Arc<AtomicBool>,
    delay_ms: Arc<AtomicU64>,
    trap: Arc<Mutex<Option<(String, Cut)>>>,
}

/// On which side of a message a wire is cut.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Cut {
    /// The message does not pass any more, nor what follows.
    Before,
    /// The message passes, and no answer to it.
    After,
}

/// Which way bytes go.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Way {
    There,
    Back,
}

impl Proxy {
    /// One to a port of this machine.
    pub(crate) fn to(port: u16) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let proxy = Self {
            port: listener.local_addr().unwrap().port(),
            is_cut: Arc::default(),
            is_deaf: Arc::default(),
            is_broken: Arc::default(),
            delay_ms: Arc::default(),
            trap: Arc::default(),
        };
        let shared = proxy.clone();
        thread::spawn(move || {
            for near in listener.incoming().map_while(Result::ok) {
                let Ok(far) = TcpStream::connect(SocketAddr::from(([127, 0, 0, 1], port))) else {
                    continue;
                };
                let (wire, back) = (shared.clone(), shared.clone());
                let (near2, far2) = (near.try_clone().unwrap(), far.try_clone().unwrap());
                thread::spawn(move || wire.carry(near, far, Way::There));
                thread::spawn(move || back.carry(far2, near2, Way::Back));
            }
        });
        proxy
    }

    /// The address of a broker behind it.
    pub(crate) fn address(&self) -> String {
        format!("nats://127.0.0.1:{}", self.port)
    }

    /// Cuts it: nothing passes any more, and nobody is told.
    pub(crate) fn cut(&self) {
        self.is_cut.store(true, Ordering::SeqCst);
        self.is_deaf.store(true, Ordering::SeqCst);
    }

    /// Cuts it as soon as somebody sends a message in which a text is.
    pub(crate) fn cut_at(&self, text: &str, side: Cut) {
        *self.trap.lock().unwrap() = Some((text.to_owned(), side));
    }

    /// Whether the message came at which it was to be cut.
    pub(crate) fn was_cut(&self) -> bool {
        self.trap.lock().unwrap().is_none() && self.is_deaf.load(Ordering::SeqCst)
    }

    /// Breaks it: connections end at once, as if nobody were there.
    pub(crate) fn break_off(&self) {
        self.is_broken.store(true, Ordering::SeqCst);
    }

    /// Mends it; what was held up passes then.
    pub(crate) fn mend(&self) {
        for fault in [&self.is_cut, &self.is_deaf, &self.is_broken] {
            fault.store(false, Ordering::SeqCst);
        }
    }

    /// Makes everything that passes wait.
    pub(crate) fn delay(&self, delay: Duration) {
        self.delay_ms.store(delay.as_millis() as u64, Ordering::SeqCst);
    }

    fn carry(&self, mut from: TcpStream, mut to: TcpStream, way: Way) {
        let mut buffer = [0; 16384];
        from.set_read_timeout(Some(Duration::from_millis(100))).unwrap();
        while !self.is_broken.load(Ordering::SeqCst) {
            let count = match from.read(&mut buffer) {
                Ok(0) => break,
                Ok(count) => count,
                Err(error) if error.kind() == std::io::ErrorKind::WouldBlock => continue,
                Err(_) => break,
            };
            thread::sleep(Duration::from_millis(self.delay_ms.load(Ordering::SeqCst)));
            let mut rest = &buffer[..count];
            if way == Way::There {
                let (passes, waits) = rest.split_at(self.watch_for(rest));
                if to.write_all(passes).is_err() {
                    break;
                }
                rest = waits;
            }
            let is_held = if way == Way::There { &self.is_cut } else { &self.is_deaf };
            while is_held.load(Ordering::SeqCst) {
                thread::sleep(Duration::from_millis(10));
            }
            if to.write_all(rest).is_err() {
                break;
            }
        }
        let _ = to.shutdown(Shutdown::Both);
        let _ = from.shutdown(Shutdown::Both);
    }

    /// Cuts the wire where the message is among these bytes at which it is to be, and returns how
    /// many of them still pass: those of the lines before.
    fn watch_for(&self, bytes: &[u8]) -> usize {
        let mut trap = self.trap.lock().unwrap();
        let Some((text, side)) = &*trap else { return 0 };
        let Some(found) = bytes.windows(text.len()).position(|part| part == text.as_bytes()) else {
            return 0;
        };
        self.is_cut.store(*side == Cut::Before, Ordering::SeqCst);
        self.is_deaf.store(true, Ordering::SeqCst);
        *trap = None;
        bytes[..found].iter().rposition(|&byte| byte == b'\n').map_or(0, |end| end + 1)
    }
}
