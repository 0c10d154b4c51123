//! Filters of images: means over boxes, weighted sums, medians, widened marks, and maps of other sizes.

mod area;
mod boxes;
mod linear;
mod median;
mod weighted;
mod widen;

pub use area::area_means;
pub use boxes::{Real, box_means};
pub use linear::interpolate_linear;
pub use median::median_of_nine;
pub use weighted::{Weights, weighted_sums};
pub use widen::widen;

/// What a filter takes for the values beyond the border of a map.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Border {
    /// The values at the border go on.
    Edge,
    /// The map is mirrored at its outermost values, which are not repeated.
    Mirror,
    /// There is nothing but zeros.
    Zero,
}

impl Border {
    /// The place among `n` values that stands for a place; `None` stands for zero.
    ///
    /// ```
    /// use fringeworks::filters::Border;
    ///
    /// assert_eq!(Border::Edge.place(-2, 10), Some(0));
    /// assert_eq!(Border::Mirror.place(-2, 10), Some(2));
    /// assert_eq!(Border::Zero.place(-2, 10), None);
    /// ```
    #[inline(always)]
    pub fn place(self, at: isize, n: usize) -> Option<usize> {
        if (at as usize) < n {
            return Some(at as usize);
        }
        self.beyond(at, n)
    }

    fn beyond(self, at: isize, n: usize) -> Option<usize> {
        let last = n as isize - 1;
        match self {
            Border::Edge => Some(at.clamp(0, last) as usize),
            Border::Zero => None,
            Border::Mirror if last == 0 => Some(0),
            Border::Mirror => {
                let turned = at.rem_euclid(2 * last);
                Some(turned.min(2 * last - turned) as usize)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::Border;

    #[test]
    fn borders() {
        let found = |border: Border| (-7..10).map(|k| border.place(k, 4)).collect::<Vec<_>>();
        let mirrored = [1, 0, 1, 2, 3, 2, 1, 0, 1, 2, 3, 2, 1, 0, 1, 2, 3];
        assert_eq!(found(Border::Mirror), mirrored.map(Some));
        assert_eq!(Border::Mirror.place(-3, 1), Some(0));
        assert_eq!(
            found(Border::Edge)[..9],
            [0, 0, 0, 0, 0, 0, 0, 0, 1].map(Some)
        );
        assert_eq!(found(Border::Edge)[16], Some(3));
        assert_eq!(found(Border::Zero)[6], None);
        assert_eq!(found(Border::Zero)[7], Some(0));
    }
}
