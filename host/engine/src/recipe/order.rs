//! The order of steps.

use std::collections::BTreeSet;

/// Steps in an order in which each comes after what it needs, and the circles among them.
pub(crate) struct Order {
    pub order: Vec<usize>,
    /// Each circle begins with its first name; each step needs the next, the last needs the first.
    pub circles: Vec<Vec<usize>>,
}

/// Orders steps by need, ties by name. Steps of a circle come where their first one would.
pub(crate) fn order(names: &[&str], needs: &[Vec<usize>]) -> Order {
    let mut open: Vec<usize> = vec![0; names.len()];
    let mut users: Vec<Vec<usize>> = vec![Vec::new(); names.len()];
    for (step, list) in needs.iter().enumerate() {
        let distinct: BTreeSet<usize> = list.iter().copied().collect();
        for need in distinct {
            if let (Some(count), Some(list)) = (open.get_mut(step), users.get_mut(need)) {
                *count += 1;
                list.push(step);
            }
        }
    }
    let key = |step: usize| (names.get(step).copied().unwrap_or(""), step);
    let mut waiting: BTreeSet<(&str, usize)> = (0..names.len()).map(key).collect();
    let mut ready: BTreeSet<(&str, usize)> = (0..names.len())
        .filter(|step| open.get(*step) == Some(&0))
        .map(key)
        .collect();
    let mut found = Order {
        order: Vec::with_capacity(names.len()),
        circles: Vec::new(),
    };
    loop {
        while let Some((name, step)) = ready.pop_first() {
            waiting.remove(&(name, step));
            found.order.push(step);
            for user in users.get(step).into_iter().flatten() {
                if let Some(count) = open.get_mut(*user) {
                    *count = count.saturating_sub(1);
                    if *count == 0 && waiting.contains(&key(*user)) {
                        ready.insert(key(*user));
                    }
                }
            }
        }
        // Every step that still waits needs another that waits, so that walking ends in a circle.
        let Some(start) = waiting.first().copied() else {
            return found;
        };
        let circle = circle(start.1, needs, &|step| waiting.contains(&key(step)), &key);
        ready.extend(circle.iter().map(|step| key(*step)));
        found.circles.push(circle);
    }
}

fn circle<'a>(
    start: usize,
    needs: &[Vec<usize>],
    waits: &dyn Fn(usize) -> bool,
    key: &dyn Fn(usize) -> (&'a str, usize),
) -> Vec<usize> {
    let mut path = Vec::new();
    let mut seen = BTreeSet::new();
    let mut step = start;
    while seen.insert(step) {
        path.push(step);
        let next = needs
            .get(step)
            .into_iter()
            .flatten()
            .copied()
            .filter(|need| waits(*need));
        match next.min_by_key(|need| key(*need)) {
            Some(next) => step = next,
            None => return path,
        }
    }
    let from = path.iter().position(|one| *one == step).unwrap_or(0);
    let mut circle = path.split_off(from);
    let first = circle
        .iter()
        .enumerate()
        .min_by_key(|(_, step)| key(**step));
    let first = first.map_or(0, |(at, _)| at);
    circle.rotate_left(first);
    circle
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn needs_come_first_and_names_break_ties() {
        let names = ["c", "b", "a", "d"];
        // d needs b and c, b needs a.
        let found = order(&names, &[vec![], vec![2], vec![], vec![1, 0, 1]]);
        let sorted: Vec<&str> = found.order.iter().map(|step| names[*step]).collect();
        assert_eq!(sorted, ["a", "b", "c", "d"]);
        assert!(found.circles.is_empty());
    }

    #[test]
    fn circles_are_found_and_the_rest_is_ordered() {
        let names = ["z", "y", "x", "w", "v"];
        // z -> y -> x -> y: the circle is x y. w needs itself. v is free.
        let found = order(&names, &[vec![1], vec![2], vec![1], vec![3], vec![]]);
        assert_eq!(found.circles, [vec![3], vec![2, 1]]);
        assert_eq!(found.order, [4, 3, 2, 1, 0]);
    }

    #[test]
    fn long_chains_and_long_circles() {
        let count = 10_000;
        let texts: Vec<String> = (0..count).map(|step| format!("s{step:05}")).collect();
        let names: Vec<&str> = texts.iter().map(String::as_str).collect();
        let chain: Vec<Vec<usize>> = (0..count)
            .map(|step| (step + 1..count).take(1).collect())
            .collect();
        assert_eq!(
            order(&names, &chain).order,
            (0..count).rev().collect::<Vec<_>>()
        );
        let ring: Vec<Vec<usize>> = (0..count).map(|step| vec![(step + 1) % count]).collect();
        let found = order(&names, &ring);
        assert_eq!((found.circles.len(), found.circles[0].len()), (1, count));
        let pairs: Vec<Vec<usize>> = (0..count).map(|step| vec![step ^ 1]).collect();
        assert_eq!(order(&names, &pairs).circles.len(), count / 2);
    }
}
