//! Pictures and numbers from the fuzzer's bytes.

#![allow(dead_code, reason = "each target reads some kinds of numbers only")]

/// Largest height and width of a picture, px: enough for every branch at borders, quick to run.
const MOST: usize = 32;

/// Reads numbers from bytes; after the last one, all are zero.
pub struct Bytes<'a>(pub &'a [u8]);

impl Bytes<'_> {
    /// The next byte.
    pub fn byte(&mut self) -> u8 {
        let Some((first, rest)) = self.0.split_first() else {
            return 0;
        };
        self.0 = rest;
        *first
    }

    /// Height and width of a picture, px.
    pub fn shape(&mut self) -> (usize, usize) {
        let mut size = || usize::from(self.byte()) % MOST + 1;
        (size(), size())
    }

    /// Any number that four bytes make, also NaN and infinity.
    pub fn single(&mut self) -> f32 {
        f32::from_le_bytes([self.byte(), self.byte(), self.byte(), self.byte()])
    }

    /// Numbers of a picture, usual ones and any.
    pub fn singles(&mut self, n: usize) -> Vec<f32> {
        (0..n)
            .map(|_| match self.byte() {
                255 => self.single(),
                usual => f32::from(usual) / 16.0 - 8.0,
            })
            .collect()
    }

    /// The same in double precision.
    pub fn doubles(&mut self, n: usize) -> Vec<f64> {
        self.singles(n).into_iter().map(f64::from).collect()
    }
}
