//! Values with the size of the picture that they make.

use crate::{Error, check_length};
use std::ops::{Deref, DerefMut};

/// Borrowed values of a picture, row after row.
///
/// It is a slice that knows its height and width: the length is checked when it is made, and it
/// dereferences to the slice.
///
/// ```
/// use fringeworks::Image;
///
/// let image = Image::new(&[1, 2, 3, 4, 5, 6], 2, 3)?;
/// assert_eq!(image.shape(), (2, 3));
/// assert_eq!(image.row(1), [4, 5, 6]);
/// assert_eq!(image.iter().sum::<i32>(), 21);
/// assert!(Image::new(&[1, 2, 3, 4, 5], 2, 3).is_err());
/// # Ok::<(), fringeworks::Error>(())
/// ```
#[derive(Debug)]
pub struct Image<'a, T> {
    values: &'a [T],
    height: usize,
    width: usize,
}

// Derived ones would ask for copies of the values.
impl<T> Clone for Image<'_, T> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<T> Copy for Image<'_, T> {}

impl<'a, T> Image<'a, T> {
    /// A picture of `height` rows and `width` columns; refuses another number of values.
    ///
    /// ```
    /// let image = fringeworks::Image::new(&[0.0; 12], 3, 4)?;
    /// assert_eq!(image.len(), 12);
    /// # Ok::<(), fringeworks::Error>(())
    /// ```
    pub fn new(values: &'a [T], height: usize, width: usize) -> Result<Self, Error> {
        // A product beyond all numbers is no length of a slice.
        let expected = height.saturating_mul(width);
        check_length("image", values.len(), expected)?;
        Ok(Self {
            values,
            height,
            width,
        })
    }

    /// Number of rows.
    ///
    /// ```
    /// assert_eq!(fringeworks::Image::new(&[0; 6], 2, 3)?.height(), 2);
    /// # Ok::<(), fringeworks::Error>(())
    /// ```
    #[inline(always)]
    pub const fn height(&self) -> usize {
        self.height
    }

    /// Number of columns.
    ///
    /// ```
    /// assert_eq!(fringeworks::Image::new(&[0; 6], 2, 3)?.width(), 3);
    /// # Ok::<(), fringeworks::Error>(())
    /// ```
    #[inline(always)]
    pub const fn width(&self) -> usize {
        self.width
    }

    /// Numbers of rows and columns.
    ///
    /// ```
    /// assert_eq!(fringeworks::Image::new(&[0; 6], 2, 3)?.shape(), (2, 3));
    /// # Ok::<(), fringeworks::Error>(())
    /// ```
    #[inline(always)]
    pub const fn shape(&self) -> (usize, usize) {
        (self.height, self.width)
    }

    /// All values, row after row, for as long as they are borrowed.
    ///
    /// ```
    /// assert_eq!(fringeworks::Image::new(&[1, 2], 2, 1)?.values(), [1, 2]);
    /// # Ok::<(), fringeworks::Error>(())
    /// ```
    #[inline(always)]
    pub const fn values(&self) -> &'a [T] {
        self.values
    }

    /// The values of a row. Panics beyond the last one.
    ///
    /// ```
    /// assert_eq!(fringeworks::Image::new(&[1, 2, 3, 4], 2, 2)?.row(1), [3, 4]);
    /// # Ok::<(), fringeworks::Error>(())
    /// ```
    #[inline(always)]
    pub fn row(&self, y: usize) -> &'a [T] {
        &self.values[y * self.width..][..self.width]
    }
}

impl<T> Deref for Image<'_, T> {
    type Target = [T];

    #[inline(always)]
    fn deref(&self) -> &[T] {
        self.values
    }
}

/// Values of a picture that a kernel changes, row after row.
///
/// ```
/// use fringeworks::ImageMut;
///
/// let mut values = [0; 6];
/// let mut image = ImageMut::new(&mut values, 2, 3)?;
/// image[4] = 7;
/// assert_eq!(image.view().row(1), [0, 7, 0]);
/// # Ok::<(), fringeworks::Error>(())
/// ```
#[derive(Debug)]
pub struct ImageMut<'a, T> {
    values: &'a mut [T],
    height: usize,
    width: usize,
}

impl<'a, T> ImageMut<'a, T> {
    /// A picture of `height` rows and `width` columns; refuses another number of values.
    ///
    /// ```
    /// let mut values = [0.0; 12];
    /// assert!(fringeworks::ImageMut::new(&mut values, 3, 4).is_ok());
    /// assert!(fringeworks::ImageMut::new(&mut values, 3, 5).is_err());
    /// ```
    pub fn new(values: &'a mut [T], height: usize, width: usize) -> Result<Self, Error> {
        Image::new(values, height, width)?;
        Ok(Self {
            values,
            height,
            width,
        })
    }

    /// The same picture, to be read.
    ///
    /// ```
    /// let mut values = [0; 6];
    /// assert_eq!(fringeworks::ImageMut::new(&mut values, 2, 3)?.view().width(), 3);
    /// # Ok::<(), fringeworks::Error>(())
    /// ```
    pub const fn view(&self) -> Image<'_, T> {
        Image {
            values: self.values,
            height: self.height,
            width: self.width,
        }
    }

    /// Numbers of rows and columns.
    ///
    /// ```
    /// let mut values = [0; 6];
    /// assert_eq!(fringeworks::ImageMut::new(&mut values, 2, 3)?.shape(), (2, 3));
    /// # Ok::<(), fringeworks::Error>(())
    /// ```
    pub const fn shape(&self) -> (usize, usize) {
        (self.height, self.width)
    }
}

impl<T> Deref for ImageMut<'_, T> {
    type Target = [T];

    #[inline(always)]
    fn deref(&self) -> &[T] {
        self.values
    }
}

impl<T> DerefMut for ImageMut<'_, T> {
    #[inline(always)]
    fn deref_mut(&mut self) -> &mut [T] {
        self.values
    }
}

/// Refuse a picture without columns.
pub(crate) fn check_columns<T>(image: Image<'_, T>) -> Result<(), Error> {
    crate::check_value("width", image.width > 0, "at least 1 px", image.width)
}

/// Refuse a picture of another shape than expected.
pub(crate) fn check_shape(
    name: &'static str,
    got: (usize, usize),
    expected: (usize, usize),
) -> Result<(), Error> {
    if got == expected {
        Ok(())
    } else {
        Err(Error::Shape {
            name,
            expected,
            got,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_size_beyond_all_numbers_is_refused() {
        assert!(Image::<u8>::new(&[], usize::MAX, 2).is_err());
        assert!(Image::<u8>::new(&[], 0, 7).is_ok());
    }
}
