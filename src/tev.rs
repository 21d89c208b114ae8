//! Shows a render in the image viewer tev (<https://github.com/Tom94/tev>) while it goes on.
//!
//! tev listens on TCP. A packet is its length (u32, its own four bytes included), its type (u8) and what the type asks
//! for; numbers are little endian, texts end with a zero byte. Two types are needed:
//!
//! | type | fields |
//! |---|---|
//! | 4, create image | grab focus (u8), name, width, height, number of channels (i32 each), name of each channel |
//! | 6, update image | grab focus (u8), name, number of channels (i32), name of each, x, y, width, height (i32 each), offset of the first value of each channel, then its stride (i64 each, in values), values (f32) |

use std::io::{self, Write};
use std::net::{TcpStream, ToSocketAddrs};
use std::time::{Duration, Instant};

const CREATE_IMAGE: u8 = 4;
const UPDATE_IMAGE: u8 = 6;
const CHANNELS: [&str; 3] = ["R", "G", "B"];

/// Longest wait for a viewer that does not answer.
const PATIENCE: Duration = Duration::from_secs(2);

/// Most pixels of a packet, whose length must fit into 32 bits.
const PACKET_PIXELS: usize = 1 << 22;

/// Least time between two pictures.
const INTERVAL: Duration = Duration::from_secs(1);

/// Showing a picture may take this share of the time, less one: the pause after it is so many times as long.
const PAUSE: u32 = 50;

/// A picture in the viewer.
#[derive(Debug)]
pub struct Tev {
    stream: TcpStream,
    name: String,
    width: u32,
    next: Instant,
}

impl Tev {
    /// Connects to `HOST:PORT` and makes a picture of that name there.
    ///
    /// # Errors
    /// If nobody listens, or does not take the picture.
    pub fn connect(address: &str, name: &str, width: u32, height: u32) -> io::Result<Self> {
        let mut failure = io::Error::other("the name has no address");
        for address in address.to_socket_addrs()? {
            match TcpStream::connect_timeout(&address, PATIENCE) {
                Ok(stream) => {
                    stream.set_write_timeout(Some(PATIENCE))?;
                    let name = name.replace('\0', " ");
                    let mut tev = Tev { stream, name, width, next: Instant::now() };
                    tev.create(height)?;
                    return Ok(tev);
                }
                Err(error) => failure = error,
            }
        }
        Err(failure)
    }

    /// Whether it is time for the next picture.
    pub fn is_due(&self) -> bool {
        Instant::now() >= self.next
    }

    /// Shows all pixels, row by row. `started`: when the work for this picture began.
    ///
    /// # Errors
    /// If the viewer is gone.
    pub fn show(&mut self, pixels: &[[f32; 3]], started: Instant) -> io::Result<()> {
        let width = self.width as usize;
        let rows = (PACKET_PIXELS / width).max(1);
        for (index, strip) in pixels.chunks(rows * width).enumerate() {
            let mut packet = Packet::new(UPDATE_IMAGE);
            packet.channels_of(&self.name, |_| ());
            for number in [0, index * rows, width, strip.len() / width] {
                packet.int(number as i32);
            }
            for offset in 0..CHANNELS.len() as i64 {
                packet.bytes(&offset.to_le_bytes());
            }
            for _ in CHANNELS {
                packet.bytes(&(CHANNELS.len() as i64).to_le_bytes());
            }
            for value in strip.iter().flatten() {
                packet.bytes(&value.to_le_bytes());
            }
            packet.send(&mut self.stream)?;
        }
        let spent = started.elapsed();
        self.next = Instant::now() + INTERVAL.max(spent * PAUSE);
        Ok(())
    }

    fn create(&mut self, height: u32) -> io::Result<()> {
        let mut packet = Packet::new(CREATE_IMAGE);
        let width = self.width;
        packet.channels_of(&self.name, |packet| {
            packet.int(width as i32);
            packet.int(height as i32);
        });
        packet.send(&mut self.stream)
    }
}

/// A packet in the making.
struct Packet(Vec<u8>);

impl Packet {
    fn new(kind: u8) -> Self {
        // Length, to be filled in; type; do not grab the focus.
        Packet(vec![0, 0, 0, 0, kind, 0])
    }
    fn bytes(&mut self, bytes: &[u8]) {
        self.0.extend_from_slice(bytes);
    }
    fn int(&mut self, number: i32) {
        self.bytes(&number.to_le_bytes());
    }
    fn text(&mut self, text: &str) {
        self.bytes(text.as_bytes());
        self.bytes(&[0]);
    }
    /// Name, what stands `between`, and the names of the channels.
    fn channels_of(&mut self, name: &str, between: impl FnOnce(&mut Self)) {
        self.text(name);
        between(self);
        self.int(CHANNELS.len() as i32);
        CHANNELS.iter().for_each(|channel| self.text(channel));
    }
    fn send(mut self, stream: &mut TcpStream) -> io::Result<()> {
        let length = (self.0.len() as u32).to_le_bytes();
        self.0[..4].copy_from_slice(&length);
        stream.write_all(&self.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Read;
    use std::net::TcpListener;

    /// Reads what the packets say, one field after another.
    struct Reader<'a>(&'a [u8]);

    impl Reader<'_> {
        fn take<const N: usize>(&mut self) -> [u8; N] {
            let (head, rest) = self.0.split_at(N);
            self.0 = rest;
            head.try_into().unwrap()
        }
        fn int(&mut self) -> i32 {
            i32::from_le_bytes(self.take())
        }
        fn long(&mut self) -> i64 {
            i64::from_le_bytes(self.take())
        }
        fn text(&mut self) -> String {
            let end = self.0.iter().position(|byte| *byte == 0).unwrap();
            let text = String::from_utf8(self.0[..end].to_vec()).unwrap();
            self.0 = &self.0[end + 1..];
            text
        }
        fn channels(&mut self) {
            assert_eq!(self.int(), 3);
            assert_eq!([self.text(), self.text(), self.text()], CHANNELS);
        }
    }

    #[test]
    fn a_viewer_gets_the_picture() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap().to_string();
        let viewer = std::thread::spawn(move || {
            let mut bytes = Vec::new();
            listener.accept().unwrap().0.read_to_end(&mut bytes).unwrap();
            bytes
        });
        let pixels = [[0.5, 1.0, 2.0], [3.0, 4.0, 5.0]];
        let mut tev = Tev::connect(&address, "a\0b", 1, 2).unwrap();
        assert!(tev.is_due());
        tev.show(&pixels, Instant::now()).unwrap();
        assert!(!tev.is_due());
        drop(tev);
        let bytes = viewer.join().unwrap();
        let length = u32::from_le_bytes(bytes[..4].try_into().unwrap()) as usize;
        let (create, update) = bytes.split_at(length);
        let mut create = Reader(&create[4..]);
        assert_eq!(create.take(), [CREATE_IMAGE, 0]);
        assert_eq!((create.text(), create.int(), create.int()), ("a b".into(), 1, 2));
        create.channels();
        assert!(create.0.is_empty());
        assert_eq!(u32::from_le_bytes(update[..4].try_into().unwrap()) as usize, update.len());
        let mut update = Reader(&update[4..]);
        assert_eq!(update.take(), [UPDATE_IMAGE, 0]);
        assert_eq!(update.text(), "a b");
        update.channels();
        assert_eq!([0; 4].map(|_| update.int()), [0, 0, 1, 2]);
        assert_eq!([0; 6].map(|_| update.long()), [0, 1, 2, 3, 3, 3]);
        let values: Vec<f32> = (0..6).map(|_| f32::from_le_bytes(update.take())).collect();
        assert_eq!(values, pixels.as_flattened());
        assert!(update.0.is_empty());
    }

    #[test]
    fn nobody_is_an_error() {
        // The port was free a moment ago.
        let address = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().to_string();
        assert!(Tev::connect(&address, "a", 1, 1).is_err());
    }
}
