//! A TCP proxy that holds, delays or closes connections, and that can switch to another server.

use std::collections::VecDeque;
use std::io::{ErrorKind, Read, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, AtomicU16, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::Duration;

/// The proxy.
#[derive(Clone, Debug)]
pub(crate) struct Proxy {
    pub(crate) port: u16,
    target: Arc<AtomicU16>,
    /// Holds what clients send.
    holds_requests: Arc<AtomicBool>,
    /// Holds what the server answers.
    holds_answers: Arc<AtomicBool>,
    /// Closes every connection.
    refuses: Arc<AtomicBool>,
    delay_ms: Arc<AtomicU64>,
    trigger: Arc<Mutex<Option<Trigger>>>,
    /// A text in requests, and one of the same length that takes its place.
    replacements: Arc<Mutex<Vec<(&'static str, &'static str)>>>,
}

/// A sequence of texts in requests after which the proxy holds all traffic.
#[derive(Debug)]
struct Trigger {
    texts: VecDeque<String>,
    hold: Hold,
}

/// What the proxy does with the request that completes a trigger.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Hold {
    /// The server does not receive the request.
    Request,
    /// The server receives the request, and the client does not receive the answer.
    Answer,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Direction {
    ToServer,
    ToClient,
}

impl Proxy {
    /// Starts a proxy to a port of this machine.
    pub(crate) fn to(target: u16) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let proxy = Self {
            port: listener.local_addr().unwrap().port(),
            target: Arc::new(AtomicU16::new(target)),
            holds_requests: Arc::default(),
            holds_answers: Arc::default(),
            refuses: Arc::default(),
            delay_ms: Arc::default(),
            trigger: Arc::default(),
            replacements: Arc::default(),
        };
        let shared = proxy.clone();
        thread::spawn(move || {
            for client in listener.incoming().map_while(Result::ok) {
                let target = shared.target.load(Ordering::SeqCst);
                let Ok(server) = TcpStream::connect(("127.0.0.1", target)) else { continue };
                let (there, back) = (shared.clone(), shared.clone());
                let (client2, server2) = (client.try_clone().unwrap(), server.try_clone().unwrap());
                thread::spawn(move || there.copy(client, server, Direction::ToServer));
                thread::spawn(move || back.copy(server2, client2, Direction::ToClient));
            }
        });
        proxy
    }

    /// Replaces a text in requests by another of the same length.
    pub(crate) fn replace(&self, text: &'static str, by: &'static str) {
        assert_eq!(text.len(), by.len());
        self.replacements.lock().unwrap().push((text, by));
    }

    /// Holds all traffic: connections stay open and no bytes pass.
    pub(crate) fn hold(&self) {
        self.holds_requests.store(true, Ordering::SeqCst);
        self.holds_answers.store(true, Ordering::SeqCst);
    }

    /// Holds all traffic once requests have contained these texts, one after the other.
    pub(crate) fn hold_at(&self, texts: &[&str], hold: Hold) {
        let texts = texts.iter().map(|&text| text.to_owned()).collect();
        *self.trigger.lock().unwrap() = Some(Trigger { texts, hold });
    }

    /// Whether the request came that completed the trigger.
    pub(crate) fn is_triggered(&self) -> bool {
        self.trigger.lock().unwrap().is_none() && self.holds_answers.load(Ordering::SeqCst)
    }

    /// Closes all connections, and every new one.
    pub(crate) fn refuse(&self) {
        self.refuses.store(true, Ordering::SeqCst);
    }

    /// Passes traffic again, and first what was held.
    pub(crate) fn pass(&self) {
        for fault in [&self.holds_requests, &self.holds_answers, &self.refuses] {
            fault.store(false, Ordering::SeqCst);
        }
    }

    /// Connects new connections to another server, and closes those to the server before.
    pub(crate) fn switch_to(&self, target: u16) {
        self.target.store(target, Ordering::SeqCst);
        self.refuse();
        thread::sleep(Duration::from_millis(200));
        self.pass();
    }

    /// Delays everything that passes.
    pub(crate) fn delay(&self, delay: Duration) {
        self.delay_ms.store(delay.as_millis() as u64, Ordering::SeqCst);
    }

    fn copy(&self, mut from: TcpStream, mut to: TcpStream, direction: Direction) {
        let mut buffer = [0; 16384];
        from.set_read_timeout(Some(Duration::from_millis(100))).unwrap();
        while !self.refuses.load(Ordering::SeqCst) {
            let count = match from.read(&mut buffer) {
                Ok(0) => break,
                Ok(count) => count,
                Err(error) if error.kind() == ErrorKind::WouldBlock => continue,
                Err(_) => break,
            };
            thread::sleep(Duration::from_millis(self.delay_ms.load(Ordering::SeqCst)));
            let holds = match direction {
                Direction::ToServer => {
                    self.replace_in(&mut buffer[..count]);
                    self.check_trigger(&buffer[..count]);
                    &self.holds_requests
                }
                Direction::ToClient => &self.holds_answers,
            };
            while holds.load(Ordering::SeqCst) {
                thread::sleep(Duration::from_millis(10));
            }
            if to.write_all(&buffer[..count]).is_err() {
                break;
            }
        }
        let _ = to.shutdown(Shutdown::Both);
        let _ = from.shutdown(Shutdown::Both);
    }

    fn replace_in(&self, bytes: &mut [u8]) {
        for (text, by) in self.replacements.lock().unwrap().iter() {
            let end = bytes.len().saturating_sub(text.len());
            for start in 0..end {
                let part = &mut bytes[start..start + text.len()];
                if part == text.as_bytes() {
                    part.copy_from_slice(by.as_bytes());
                }
            }
        }
    }

    /// Holds traffic if these bytes of a request complete the trigger.
    fn check_trigger(&self, bytes: &[u8]) {
        let mut trigger = self.trigger.lock().unwrap();
        let Some(Trigger { texts, hold }) = &mut *trigger else { return };
        let contains = |text: &str| bytes.windows(text.len()).any(|part| part == text.as_bytes());
        while texts.front().is_some_and(|text| contains(text)) {
            texts.pop_front();
        }
        if texts.is_empty() {
            self.holds_requests.store(*hold == Hold::Request, Ordering::SeqCst);
            self.holds_answers.store(true, Ordering::SeqCst);
            *trigger = None;
        }
    }
}
