//! What a worker's plugin writes to its output streams: drained always, kept in part.

use std::collections::VecDeque;
use std::io::Read;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Bytes that are kept.
const KEPT: usize = 4096;

/// The last of what a process wrote.
#[derive(Debug, Default)]
pub struct Output(Mutex<Kept>);

#[derive(Debug, Default)]
struct Kept {
    last: VecDeque<u8>,
    /// Bytes since the text was last taken.
    fresh: u64,
}

impl Output {
    /// Reads `from` until it ends, in a thread of its own, so that the process never waits for us.
    pub fn drain(mut from: impl Read + Send + 'static) -> Arc<Output> {
        let output = Arc::new(Output::default());
        let own = Arc::clone(&output);
        std::thread::spawn(move || {
            let mut buffer = vec![0; 1 << 16];
            while let Ok(count @ 1..) = from.read(&mut buffer) {
                own.add(&buffer[..count]);
            }
        });
        output
    }

    fn kept(&self) -> MutexGuard<'_, Kept> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn add(&self, bytes: &[u8]) {
        let mut kept = self.kept();
        kept.fresh += bytes.len() as u64;
        kept.last.extend(&bytes[bytes.len().saturating_sub(KEPT)..]);
        let excess = kept.last.len().saturating_sub(KEPT);
        kept.last.drain(..excess);
    }

    /// The last of it.
    pub fn text(&self) -> String {
        let kept = self.kept();
        let (front, back) = kept.last.as_slices();
        String::from_utf8_lossy(&[front, back].concat()).into_owned()
    }

    /// What was written since this was last asked, or the end of it.
    pub fn take(&self) -> Option<String> {
        let fresh = std::mem::take(&mut self.kept().fresh);
        if fresh == 0 {
            return None;
        }
        let text = self.text();
        let kept = usize::try_from(fresh).unwrap_or(usize::MAX).min(text.len());
        let begin = (text.len() - kept..=text.len()).find(|at| text.is_char_boundary(*at));
        let last = text[begin.unwrap_or(0)..].trim_end();
        Some(if fresh > KEPT as u64 {
            format!("{fresh} bytes, at the end: {last}")
        } else {
            last.to_owned()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flood_is_kept_in_part_and_told_once() {
        let output = Output::default();
        assert_eq!(output.take(), None);
        output.add(b"first\n");
        assert_eq!(output.take().unwrap(), "first");
        output.add("é\n".as_bytes());
        assert_eq!(output.take().unwrap(), "é");
        for _ in 0..100 {
            output.add(&[b'x'; 100_000]);
        }
        output.add(b"\nend\n");
        let text = output.take().unwrap();
        assert!(text.starts_with("10000005 bytes") && text.ends_with("xx\nend"));
        assert_eq!(output.text().len(), KEPT);
        assert_eq!(output.take(), None);
    }
}
