//! Sizes that are transformed fast.

/// The smallest even number of the form 2^a 3^b 5^c 7^d from `least` on; at least 2.
#[must_use]
pub fn good_size(least: usize) -> usize {
    let mut size = least.max(2).next_multiple_of(2);
    while !is_smooth(size) {
        size += 2;
    }
    size
}

fn is_smooth(mut size: usize) -> bool {
    for factor in [2, 3, 5, 7] {
        while size.is_multiple_of(factor) {
            size /= factor;
        }
    }
    size == 1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn good_sizes_are_even_and_smooth() {
        for (least, size) in [
            (0, 2),
            (1, 2),
            (2, 2),
            (11, 12),
            (1000, 1000),
            (1001, 1008),
            (4097, 4116),
        ] {
            assert_eq!(good_size(least), size);
        }
    }
}
