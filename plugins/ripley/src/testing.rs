//! Reading real tables for tests.

/// Two columns of a text table, by name or, without a header, by number; rows that are no numbers
/// are left out. None if the file is not there.
pub(crate) fn columns<const N: usize>(path: &str, names: [&str; N]) -> Option<[Vec<f64>; N]> {
    let text = std::fs::read_to_string(path).ok()?;
    let split = |line: &str| -> Vec<String> {
        let parts: Vec<&str> = if line.contains(',') {
            line.split(',').collect()
        } else {
            line.split_whitespace().collect()
        };
        parts
            .iter()
            .map(|part| part.trim().trim_matches('"').to_owned())
            .collect()
    };
    let header = split(text.lines().next()?);
    let place = |name: &str| match name.parse() {
        Ok(number) => Some(number),
        Err(_) => header.iter().position(|one| one == name),
    };
    let mut places = [0; N];
    for (at, name) in places.iter_mut().zip(names) {
        *at = place(name)?;
    }
    let mut found: [Vec<f64>; N] = std::array::from_fn(|_| Vec::new());
    for line in text.lines() {
        let parts = split(line);
        let values = places.map(|at| parts.get(at).and_then(|part| part.parse::<f64>().ok()));
        if values.iter().all(Option::is_some) {
            found
                .iter_mut()
                .zip(values)
                .for_each(|(axis, value)| axis.extend(value));
        }
    }
    Some(found)
}
