//! Which half a localisation belongs to.

use puncta_sdk::Failure;

/// What is put into the halves as a whole.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Rule {
    /// Time blocks of so many frames, half of them drawn at random.
    RandomBlocks(f64),
    /// Time blocks of so many frames, in turn.
    Blocks(f64),
    /// Every localisation (or molecule) at random.
    Random,
}

/// A unit that no half gets.
pub const NONE: u32 = u32::MAX;

/// The units that are put into the halves.
#[derive(Clone, Debug, PartialEq)]
pub struct Units {
    /// Unit of each row; [`NONE`] where it has none. Empty: the unit is the row.
    pub of_row: Vec<u32>,
    /// Number of units.
    pub count: usize,
    /// The halves of blocks in turn; empty when they are drawn.
    fixed: Vec<bool>,
}

impl Units {
    /// The units of `rows` rows. `t` are the frames (needed for blocks), `molecules` the numbers of
    /// the molecules (from 1; 0, negative and NaN stand for a molecule of its own).
    ///
    /// # Errors
    /// When there are fewer than two units.
    pub fn new(
        rule: Rule,
        rows: usize,
        t: Option<&[f64]>,
        molecules: Option<&[f64]>,
    ) -> Result<Units, Failure> {
        let size = match rule {
            Rule::Random => None,
            Rule::Blocks(size) | Rule::RandomBlocks(size) => Some(size.max(1.0)),
        };
        let first = molecules.map(|molecules| first_rows(molecules, t.unwrap_or(&[])));
        let units = match size {
            None => match first {
                None => Units {
                    of_row: Vec::new(),
                    count: rows,
                    fixed: Vec::new(),
                },
                Some(first) => ranks(&first.iter().map(|row| i64::from(*row)).collect::<Vec<_>>()),
            },
            Some(size) => {
                let t = t.unwrap_or(&[]);
                let block = |row: usize| match t.get(row) {
                    Some(t) if t.is_finite() => (t / size).floor() as i64,
                    _ => i64::MAX,
                };
                let row = |i: usize| first.as_ref().map_or(i, |first| first[i] as usize);
                let blocks: Vec<i64> = (0..t.len()).map(|i| block(row(i))).collect();
                let mut units = ranks(&blocks);
                if matches!(rule, Rule::Blocks(_)) {
                    units.fixed = vec![false; units.count];
                    for (unit, block) in units.of_row.iter().zip(&blocks) {
                        if let Some(half) = units.fixed.get_mut(*unit as usize) {
                            *half = block.rem_euclid(2) == 1;
                        }
                    }
                }
                units
            }
        };
        units.check(rule)
    }

    fn check(self, rule: Rule) -> Result<Units, Failure> {
        let alike = !self.fixed.is_empty() && self.fixed.iter().all(|half| *half == self.fixed[0]);
        if self.count >= 2 && !alike {
            return Ok(self);
        }
        Err(match rule {
            Rule::Random => {
                Failure::bad_input(format!("{} localisations make no two halves", self.count))
                    .remedy("give a table with more localisations or molecules")
            }
            Rule::Blocks(size) | Rule::RandomBlocks(size) => Failure::bad_parameter(
                "block",
                format!("all localisations lie in blocks of {size} frames of one half"),
            )
            .remedy("lower block, or set split to random"),
        })
    }

    /// Whether the halves are drawn, so that repeats differ.
    pub fn is_random(&self) -> bool {
        self.fixed.is_empty()
    }

    /// Which units the first half gets in a repeat.
    pub fn first_half(&self, seed: u64, repeat: u64) -> Half {
        let seed = mix(seed ^ mix(repeat.wrapping_add(0x5EED)));
        if !self.is_random() {
            return Half::Listed(self.fixed.iter().map(|odd| !odd).collect());
        }
        if self.of_row.is_empty() {
            return Half::Tossed(seed);
        }
        // Half of the units, exactly: few blocks would often be shared unevenly by coins.
        let mut order: Vec<(u64, u32)> = (0..self.count as u32)
            .map(|unit| (mix(seed ^ u64::from(unit)), unit))
            .collect();
        let middle = self.count / 2;
        let mut first = vec![false; self.count];
        if middle < order.len() {
            order.select_nth_unstable(middle);
        }
        for (_, unit) in &order[..middle] {
            first[*unit as usize] = true;
        }
        Half::Listed(first)
    }
}

/// The units of the first half.
#[derive(Clone, Debug, PartialEq)]
pub enum Half {
    /// Each by a coin.
    Tossed(u64),
    /// As listed.
    Listed(Vec<bool>),
}

impl Half {
    /// Whether the first half has a unit.
    #[inline]
    pub fn has(&self, unit: u32) -> bool {
        match self {
            Half::Tossed(seed) => mix(seed ^ u64::from(unit)) >> 63 == 1,
            Half::Listed(first) => first.get(unit as usize).copied().unwrap_or(false),
        }
    }
}

/// The finaliser of SplitMix64 (Steele et al., OOPSLA 2014).
fn mix(value: u64) -> u64 {
    let mut z = value.wrapping_add(0x9E37_79B9_7F4A_7C15);
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

/// For each row the earliest row of its molecule (by frame, then by row).
fn first_rows(molecules: &[f64], t: &[f64]) -> Vec<u32> {
    let mut order: Vec<u32> = (0..molecules.len() as u32)
        .filter(|row| molecules[*row as usize] > 0.0)
        .collect();
    let frame = |row: u32| t.get(row as usize).copied().unwrap_or(0.0);
    order.sort_unstable_by(|a, b| {
        let molecule = molecules[*a as usize].total_cmp(&molecules[*b as usize]);
        molecule
            .then_with(|| frame(*a).total_cmp(&frame(*b)))
            .then_with(|| a.cmp(b))
    });
    let mut first: Vec<u32> = (0..molecules.len() as u32).collect();
    for molecule in order.chunk_by(|a, b| molecules[*a as usize] == molecules[*b as usize]) {
        for row in molecule {
            first[*row as usize] = molecule[0];
        }
    }
    first
}

/// Numbers the different keys in their order; `i64::MAX` is no unit.
fn ranks(keys: &[i64]) -> Units {
    let mut known: Vec<i64> = keys.iter().copied().filter(|key| *key < i64::MAX).collect();
    known.sort_unstable();
    known.dedup();
    let rank = |key: &i64| known.binary_search(key).map_or(NONE, |rank| rank as u32);
    Units {
        of_row: keys.iter().map(rank).collect(),
        count: known.len(),
        fixed: Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_in_turn_as_the_reference_application_splits_them() {
        let t = [0.0, 99.0, 100.0, 250.0, 1e9 + 101.0, f64::NAN, -1.0];
        let units = Units::new(Rule::Blocks(100.0), 7, Some(&t), None).unwrap();
        let first = units.first_half(7, 0);
        let halves: Vec<bool> = units.of_row.iter().map(|u| first.has(*u)).collect();
        assert_eq!(halves, [true, true, false, true, false, false, false]);
        assert_eq!((units.of_row[5], units.count), (NONE, 5));
        assert!(!units.is_random());
        let even = Units::new(Rule::Blocks(100.0), 2, Some(&[0.0, 200.0]), None);
        assert!(even.unwrap_err().to_string().contains("lower block"));
    }

    #[test]
    fn half_of_the_blocks_are_drawn() {
        let t: Vec<f64> = (0..1000).map(f64::from).collect();
        let units = Units::new(Rule::RandomBlocks(50.0), 1000, Some(&t), None).unwrap();
        let half = |repeat| {
            let half = units.first_half(3, repeat);
            (0..20).map(|u| half.has(u)).collect::<Vec<_>>()
        };
        for repeat in 0..20 {
            assert_eq!(half(repeat).iter().filter(|h| **h).count(), 10);
        }
        assert_ne!(half(0), half(1));
        // The order of rows does not matter.
        let turned: Vec<f64> = t.iter().rev().copied().collect();
        let other = Units::new(Rule::RandomBlocks(50.0), 1000, Some(&turned), None).unwrap();
        assert_eq!(other.first_half(3, 5), units.first_half(3, 5));
        assert!(Units::new(Rule::RandomBlocks(1000.0), 1000, Some(&t), None).is_err());
    }

    #[test]
    fn a_molecule_stays_together() {
        let t = [5.0, 0.0, 12.0, 3.0, 13.0, 14.0];
        let molecules = [2.0, 1.0, 1.0, 0.0, f64::NAN, 2.0];
        let units = Units::new(Rule::Random, 6, Some(&t), Some(&molecules)).unwrap();
        assert_eq!(units.count, 4);
        assert_eq!(units.of_row[0], units.of_row[5]);
        assert_eq!(units.of_row[1], units.of_row[2]);
        let units = Units::new(Rule::Blocks(10.0), 6, Some(&t), Some(&molecules)).unwrap();
        assert_eq!(units.of_row, [0, 0, 0, 0, 1, 0]);
    }

    #[test]
    fn coins_are_fair_and_differ() {
        let units = Units::new(Rule::Random, 10_000, None, None).unwrap();
        let count = |half: &Half| (0..10_000).filter(|unit| half.has(*unit)).count();
        let (a, b) = (units.first_half(1, 0), units.first_half(1, 1));
        for half in [&a, &b] {
            assert!((4800..5200).contains(&count(half)), "{}", count(half));
        }
        let both = (0..10_000).filter(|u| a.has(*u) && b.has(*u)).count();
        assert!((2350..2650).contains(&both));
        assert!(Units::new(Rule::Random, 1, None, None).is_err());
        assert!(Units::new(Rule::Random, 0, None, None).is_err());
    }
}
