//! An address that stays while the service behind it goes away and comes back elsewhere.

use std::io::{Read, Write};
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream};
use std::sync::{Arc, Mutex};
use std::thread;

pub(crate) struct Relay {
    pub(crate) address: SocketAddr,
    behind: Arc<Mutex<SocketAddr>>,
}

impl Relay {
    /// Passes everything on to a service.
    pub(crate) fn to(service: SocketAddr) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        let behind = Arc::new(Mutex::new(service));
        let shared = Arc::clone(&behind);
        thread::spawn(move || {
            for connection in listener.incoming() {
                let (Ok(client), service) = (connection, *shared.lock().unwrap()) else { return };
                // Nobody behind: the client's connection ends.
                let Ok(server) = TcpStream::connect(service) else { continue };
                pass(client.try_clone().unwrap(), server.try_clone().unwrap());
                pass(server, client);
            }
        });
        Self { address, behind }
    }

    /// From now on another one.
    pub(crate) fn set(&self, service: SocketAddr) {
        *self.behind.lock().unwrap() = service;
    }
}

fn pass(mut from: TcpStream, mut to: TcpStream) {
    thread::spawn(move || {
        let mut buffer = [0; 65536];
        while let Ok(count @ 1..) = from.read(&mut buffer) {
            if to.write_all(&buffer[..count]).is_err() {
                break;
            }
        }
        let _ = to.shutdown(Shutdown::Both);
        let _ = from.shutdown(Shutdown::Both);
    });
}
