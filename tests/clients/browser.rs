//! The example for browsers, in one, from another origin than the service's.

use crate::scripts::FIGURES;
use crate::server::Server;
use crate::tools::{checkout, require, run};
use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener};
use std::process::Command;
use std::thread;

#[test]
fn the_page_saves_a_mesh_where_its_origin_is_let_in() {
    for tool in ["chromium", "node", "tests/studio/node_modules/playwright-core"] {
        require(tool);
    }
    let pages = format!("http://{}", serve_folder("examples"));
    let allowed = Server::start(&["--cors-origin", &pages]);
    let closed = Server::start(&[]);
    let shown = run(Command::new("node")
        .arg(checkout("tests/clients/page.mjs"))
        .arg(pages)
        .args([&allowed, &closed].map(|server| format!("http://{}", server.public))));
    assert!(shown.starts_with(FIGURES), "{shown}");
}

/// Serves the files of a folder of the checkout.
fn serve_folder(folder: &str) -> SocketAddr {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    let folder = checkout(folder);
    thread::spawn(move || {
        for connection in listener.incoming() {
            let Ok(mut connection) = connection else { return };
            let folder = folder.clone();
            thread::spawn(move || {
                let mut request = [0; 8192];
                let count = connection.read(&mut request).unwrap_or_default();
                let line = String::from_utf8_lossy(&request[..count]).into_owned();
                let path = line.split(' ').nth(1).unwrap_or_default().split('?').next().unwrap();
                let kind = if path.ends_with(".html") { "text/html" } else { "text/javascript" };
                let answer = match std::fs::read(folder.join(path.trim_start_matches('/'))) {
                    Ok(body) => {
                        let head = format!(
                            "HTTP/1.1 200 OK\r\ncontent-type: {kind}\r\ncontent-length: {}\r\n\
                             connection: close\r\n\r\n",
                            body.len()
                        );
                        [head.as_bytes(), &body].concat()
                    }
                    Err(_) => b"HTTP/1.1 404 Not Found\r\ncontent-length: 0\r\n\r\n".to_vec(),
                };
                let _ = connection.write_all(&answer);
            });
        }
    });
    address
}
