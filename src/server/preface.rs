//! Sees a connection that begins in HTTP/2, so that its client gets an answer.
//!
//! HTTP/2 is not spoken. The HTTP library closes a connection that begins with its preface (RFC
//! 9113, section 3.4) without a word; a version that nobody speaks it refuses with 400. So the
//! version in the preface is changed into such a one on its way in.

/// The start of the preface, up to the digit of its version.
const START: &[u8] = b"PRI * HTTP/";
/// A version that is refused with an answer.
const UNKNOWN_VERSION: u8 = b'9';

/// How much of the preface a connection has begun with.
#[derive(Debug, Default)]
pub(super) struct Preface {
    matched: usize,
    is_done: bool,
}

impl Preface {
    /// Sees the next bytes of the connection, and changes the version where they are a preface.
    pub(super) fn see(&mut self, bytes: &mut [u8]) {
        for byte in bytes {
            if self.is_done {
                return;
            }
            match START.get(self.matched) {
                Some(expected) if expected == byte => self.matched += 1,
                Some(_) => self.is_done = true,
                None => {
                    if *byte == b'2' {
                        *byte = UNKNOWN_VERSION;
                    }
                    self.is_done = true;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What becomes of bytes that come in pieces of so many.
    fn seen(bytes: &[u8], length: usize) -> Vec<u8> {
        let (mut preface, mut bytes) = (Preface::default(), bytes.to_vec());
        bytes.chunks_mut(length).for_each(|piece| preface.see(piece));
        bytes
    }

    #[test]
    fn the_version_of_the_preface_is_changed_however_it_comes() {
        let bytes = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\nPRI * HTTP/2.0\r\n\r\n";
        for length in [1, 5, 11, 12, bytes.len()] {
            let changed = seen(bytes, length);
            assert_eq!(&changed[..], b"PRI * HTTP/9.0\r\n\r\nSM\r\n\r\nPRI * HTTP/2.0\r\n\r\n");
        }
    }

    #[test]
    fn other_requests_are_left_as_they_are() {
        for bytes in [&b"PRI * HTTP/1.1\r\n"[..], b"GET / HTTP/2.0\r\n", b"PRO * HTTP/2.0\r\n"] {
            assert_eq!(seen(bytes, 3), bytes);
        }
    }
}
