//! Frames with descriptors over a Unix socket.
//!
//! A frame is its length (u64) and its number of descriptors (u32), little endian, then for every
//! 128 descriptors one byte that carries them, then the JSON text.

use rustix::net::{
    RecvAncillaryBuffer, RecvAncillaryMessage, RecvFlags, SendAncillaryBuffer,
    SendAncillaryMessage, SendFlags,
};
use serde::{Serialize, de::DeserializeOwned};
use std::io::{self, IoSlice, IoSliceMut, Read, Write};
use std::mem::MaybeUninit;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::os::unix::net::UnixStream;

/// Longest text of a frame.
const MAX_BYTES: u64 = 1 << 28;
const BATCH: usize = 128;
/// Bytes of a text that are taken at once.
const PIECE: u64 = 1 << 20;
/// Most descriptors of a frame.
const MAX_DESCRIPTORS: usize = 65_536;

/// Sends a message with descriptors.
pub fn send<M: Serialize>(
    mut socket: &UnixStream,
    message: &M,
    descriptors: &[BorrowedFd<'_>],
) -> io::Result<()> {
    let text = serde_json::to_vec(message)?;
    let mut head = Vec::with_capacity(12);
    head.extend_from_slice(&(text.len() as u64).to_le_bytes());
    head.extend_from_slice(
        &u32::try_from(descriptors.len())
            .unwrap_or(u32::MAX)
            .to_le_bytes(),
    );
    socket.write_all(&head)?;
    for batch in descriptors.chunks(BATCH) {
        let mut space = vec![MaybeUninit::uninit(); rustix::cmsg_space!(ScmRights(BATCH))];
        let mut control = SendAncillaryBuffer::new(&mut space);
        if !control.push(SendAncillaryMessage::ScmRights(batch)) {
            return Err(io::Error::other("too many descriptors at once"));
        }
        rustix::net::sendmsg(
            socket.as_fd(),
            &[IoSlice::new(b"d")],
            &mut control,
            SendFlags::NOSIGNAL,
        )?;
    }
    socket.write_all(&text)
}

/// Receives a message with its descriptors. An orderly end of the other side is `UnexpectedEof`.
///
/// Where the socket has a read timeout, `patient` is asked at each whether to go on waiting for
/// the rest of the message.
pub fn receive<M: DeserializeOwned>(
    socket: &UnixStream,
    patient: &dyn Fn() -> bool,
) -> io::Result<(M, Vec<OwnedFd>)> {
    let mut head = [0; 12];
    read(socket, &mut head, patient)?;
    let [a, b, c, d, e, f, g, h, i, j, k, l] = head;
    let bytes = u64::from_le_bytes([a, b, c, d, e, f, g, h]);
    let count = u32::from_le_bytes([i, j, k, l]) as usize;
    if bytes > MAX_BYTES || count > MAX_DESCRIPTORS {
        return Err(io::Error::other("a frame is longer than anything we send"));
    }
    let mut descriptors = Vec::with_capacity(count);
    while descriptors.len() < count {
        match receive_batch(socket, &mut descriptors) {
            Err(error) if waits(&error) && patient() => {}
            other => other?,
        }
    }
    // The length is the other side's word: memory is taken as the text arrives.
    let mut text = Vec::new();
    while (text.len() as u64) < bytes {
        let begin = text.len();
        let piece = (bytes - begin as u64).min(PIECE);
        text.resize(begin + usize::try_from(piece).unwrap_or(0), 0);
        read(socket, &mut text[begin..], patient)?;
    }
    Ok((serde_json::from_slice(&text)?, descriptors))
}

fn waits(error: &io::Error) -> bool {
    use io::ErrorKind::{Interrupted, TimedOut, WouldBlock};
    matches!(error.kind(), WouldBlock | TimedOut | Interrupted)
}

fn read(
    mut socket: &UnixStream,
    mut into: &mut [u8],
    patient: &dyn Fn() -> bool,
) -> io::Result<()> {
    while !into.is_empty() {
        match socket.read(into) {
            Ok(0) => return Err(io::ErrorKind::UnexpectedEof.into()),
            Ok(count) => into = into.get_mut(count..).unwrap_or_default(),
            Err(error) if waits(&error) && patient() => {}
            Err(error) => return Err(error),
        }
    }
    Ok(())
}

fn receive_batch(socket: &UnixStream, descriptors: &mut Vec<OwnedFd>) -> io::Result<()> {
    let mut space = vec![MaybeUninit::uninit(); rustix::cmsg_space!(ScmRights(BATCH))];
    let mut control = RecvAncillaryBuffer::new(&mut space);
    let mut byte = [0];
    let got = rustix::net::recvmsg(
        socket.as_fd(),
        &mut [IoSliceMut::new(&mut byte)],
        &mut control,
        RecvFlags::CMSG_CLOEXEC,
    )?;
    let before = descriptors.len();
    for message in control.drain() {
        if let RecvAncillaryMessage::ScmRights(received) = message {
            descriptors.extend(received);
        }
    }
    if got.bytes == 0 || descriptors.len() == before {
        return Err(io::ErrorKind::UnexpectedEof.into());
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_carry_many_descriptors() {
        let (a, b) = UnixStream::pair().unwrap();
        let files: Vec<OwnedFd> = (0..300)
            .map(|_| {
                rustix::fs::open(
                    "/dev/null",
                    rustix::fs::OFlags::RDONLY,
                    rustix::fs::Mode::empty(),
                )
                .unwrap()
            })
            .collect();
        let borrowed: Vec<BorrowedFd<'_>> = files.iter().map(AsFd::as_fd).collect();
        send(&a, &"hello", &borrowed).unwrap();
        send(&a, &"again", &[]).unwrap();
        let (text, received): (String, _) = receive(&b, &|| true).unwrap();
        assert_eq!((text.as_str(), received.len()), ("hello", 300));
        let (text, received): (String, _) = receive(&b, &|| true).unwrap();
        assert_eq!((text.as_str(), received.len()), ("again", 0));
        b.set_read_timeout(Some(std::time::Duration::from_millis(1)))
            .unwrap();
        let error = receive::<String>(&b, &|| false).unwrap_err();
        assert!(waits(&error), "{error}");
        drop(a);
        let error = receive::<String>(&b, &|| true).unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::UnexpectedEof);
    }
}
