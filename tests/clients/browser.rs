//! The example for browsers, in one, from another origin than the service's.

use crate::server::Server;
use crate::tools::{checkout, require, run};
use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener};
use std::path::Path;
use std::process::Command;
use std::thread;

#[test]
fn the_page_makes_a_mesh_where_its_origin_is_let_in() {
    require("chromium");
    let pages = serve_folder("examples");
    let allowed = Server::start(&["--cors-origin", &format!("http://{pages}")]);
    let shown = shown_by_browser(pages, allowed.public);
    assert!(shown.contains(" vertices, ") && shown.contains("blob:http://"), "{shown}");
    let closed = Server::start(&[]);
    let shown = shown_by_browser(pages, closed.public);
    assert!(shown.contains("Refused. "), "{shown}");
}

/// What the page has become after it has asked the service.
fn shown_by_browser(pages: SocketAddr, service: SocketAddr) -> String {
    let profile =
        Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("browser-{}", service.port()));
    let address = format!("http://{pages}/browser.html?draw&service=http://{service}");
    let shown = run(Command::new("chromium")
        .args(["--headless=new", "--no-sandbox", "--disable-gpu", "--dump-dom"])
        .args(["--virtual-time-budget=10000", &format!("--user-data-dir={}", profile.display())])
        .arg(address));
    let _ = std::fs::remove_dir_all(profile);
    shown
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
