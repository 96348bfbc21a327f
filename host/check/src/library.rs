//! Checks of the file and of its tables.
#![allow(unsafe_code)]

use crate::check::Check;
use crate::child::{Found, Ground, Verdict};
use crate::plugin::{Instance, Plugin, status_name};
use crate::raw::Kind;
use object::{Object as _, ObjectSymbol as _, SymbolKind};
use puncta_abi as abi;
use puncta_engine::plugins::inspect::inspect;
use std::path::Path;
use std::time::{Duration, Instant};

/// How long opening and describing may take.
const QUICK: Duration = Duration::from_secs(1);

pub fn find(check: Check, ground: &Ground) -> Option<Found> {
    Some(match check {
        Check::Whole => whole(&ground.orders.library),
        Check::Symbol => symbol(&ground.orders.library),
        Check::SymbolKind => symbol_kind(&ground.orders.library),
        Check::Opens => Plugin::open(&ground.orders.library).map(|_| Verdict::Passed),
        Check::Tables => tables(&ground.orders.library),
        Check::Functions => functions(&ground.orders.library),
        Check::Door => door(&ground.orders.library),
        Check::Describe => ground.manifest().map(|_| Verdict::Passed),
        Check::Create => ground.instance().map(|_| Verdict::Passed),
        Check::DescribeAgain => describe_again(ground),
        Check::QuickToOpen => quick(ground),
        Check::GetUnknown => get_unknown(ground),
        Check::GetAgain => get_again(ground),
        Check::NullPlaces => null_places(ground),
        Check::CreateAgain => create_again(ground),
        Check::PoorHost => poor_host(ground),
        Check::FutureHost => Instance::open(&ground.orders.library, Kind::Future)
            .map(|_| Verdict::Passed)
            .map_err(|why| format!("with a later host, {why}")),
        _ => return None,
    })
}

fn bytes(library: &Path) -> Result<Vec<u8>, String> {
    std::fs::read(library).map_err(|error| format!("it cannot be read: {error}"))
}

/// The reasons that are about the symbol belong to the next check.
fn about_symbol(sentence: &str) -> bool {
    sentence.contains("ABI number") || sentence.contains("no Puncta plugin")
}

fn whole(library: &Path) -> Found {
    match inspect(library, &bytes(library)?) {
        Err(failure) if !about_symbol(&failure.message) => Err(failure.message),
        _ => Ok(Verdict::Passed),
    }
}

fn symbol(library: &Path) -> Found {
    let bytes = bytes(library)?;
    inspect(library, &bytes).map_err(|failure| failure.message)?;
    let file = object::File::parse(&*bytes).map_err(|error| error.to_string())?;
    let names = file
        .dynamic_symbols()
        .filter(object::ObjectSymbol::is_definition);
    let names = names.filter_map(|symbol| symbol.name().ok().map(str::to_owned));
    let other = names.into_iter().find(|name| {
        let name = name.trim_start_matches('_');
        name.starts_with(abi::SYMBOL_PREFIX) && name != abi::SYMBOL
    });
    match other {
        Some(name) => Err(format!("it also exports {name}")),
        None => Ok(Verdict::Passed),
    }
}

fn symbol_kind(library: &Path) -> Found {
    let bytes = bytes(library)?;
    let file = object::File::parse(&*bytes).map_err(|error| error.to_string())?;
    let found = file.dynamic_symbols().find(|symbol| {
        let name = symbol.name().unwrap_or_default();
        name == abi::SYMBOL || name.strip_prefix('_') == Some(abi::SYMBOL)
    });
    let symbol = found.ok_or("it exports no symbol")?;
    if symbol.kind() == SymbolKind::Text {
        return Err("the symbol is a function".into());
    }
    // Only ELF tells the size.
    if symbol.size() > 0 && symbol.size() < size_of::<abi::Plugin>() as u64 {
        let size = symbol.size();
        return Err(format!(
            "the symbol has {size} bytes, too few for the table"
        ));
    }
    Ok(Verdict::Passed)
}

fn tables(library: &Path) -> Found {
    let plugin = Plugin::open(library)?;
    let table = plugin.table();
    if (table.size as usize) < size_of::<abi::Plugin>() {
        return Err(format!(
            "its table has {} bytes, and this host's {}",
            table.size,
            size_of::<abi::Plugin>()
        ));
    }
    if table.number != abi::ABI_NUMBER {
        return Err(format!(
            "its table says ABI number {}, and this host has {}",
            table.number,
            abi::ABI_NUMBER
        ));
    }
    Ok(Verdict::Passed)
}

fn functions(library: &Path) -> Found {
    let plugin = Plugin::open(library)?;
    let table = plugin.table();
    let there = [
        ("describe", table.describe.is_some()),
        ("create", table.create.is_some()),
        ("destroy", table.destroy.is_some()),
        ("get", table.get.is_some()),
    ];
    match there.iter().find(|(_, there)| !there) {
        Some((name, _)) => Err(format!("it has no function {name}")),
        None => Ok(Verdict::Passed),
    }
}

fn door(library: &Path) -> Found {
    let inspected = inspect(library, &bytes(library)?).map_err(|failure| failure.message)?;
    if !inspected.door {
        return Ok(Verdict::Skipped(
            "it has no door, as plugins in C; its tables cannot be compared",
        ));
    }
    puncta_door::check(library)
        .map(|_| Verdict::Passed)
        .map_err(|why| format!("it was built with other tables: {why}"))
}

fn describe_again(ground: &Ground) -> Found {
    let instance = ground.instance()?;
    let first = instance.plugin.text()?;
    instance.plugin.destroy(instance.number);
    if instance.plugin.text()? != first {
        return Err("the second description differs from the first".into());
    }
    Ok(Verdict::Passed)
}

fn quick(ground: &Ground) -> Found {
    let begin = Instant::now();
    ground.instance()?;
    let time = begin.elapsed();
    if time > QUICK {
        return Err(format!(
            "opening and describing it took {:.1} s",
            time.as_secs_f64()
        ));
    }
    Ok(Verdict::Passed)
}

fn get_unknown(ground: &Ground) -> Found {
    let instance = ground.instance()?;
    let names: [&[u8]; 8] = [
        b"nothing/1",
        b"call/1 ",
        b"call/11",
        b"call/",
        b"call/2000000",
        b"",
        b"\xff\xfe",
        b"call/1\0",
    ];
    for name in names {
        if !instance.plugin.get(name).is_null() {
            let name = String::from_utf8_lossy(name);
            return Err(format!("get answers {name:?} with a table"));
        }
    }
    Ok(Verdict::Passed)
}

fn get_again(ground: &Ground) -> Found {
    let instance = ground.instance()?;
    let call = || instance.plugin.get(abi::CALL_1.as_bytes());
    if call() != call() {
        return Err("call/1 has another address the second time".into());
    }
    Ok(Verdict::Passed)
}

fn null_places(ground: &Ground) -> Found {
    let instance = ground.instance()?;
    let table = instance.plugin.table();
    let (Some(describe), Some(create)) = (table.describe, table.create) else {
        return Err("functions are missing".into());
    };
    let mut number = 0;
    ground.doing("describe with a null place");
    // SAFETY: null is what is to be refused; everything else outlives the calls.
    unsafe {
        if describe(std::ptr::null_mut()) == abi::STATUS_OK {
            return Err("describe accepts a null place".into());
        }
        ground.doing("create with a null host");
        if create(std::ptr::null(), &raw mut number) == abi::STATUS_OK {
            return Err("create accepts a null host".into());
        }
        ground.doing("create with a null place");
        if create(Kind::Present.table(), std::ptr::null_mut()) == abi::STATUS_OK {
            return Err("create accepts a null place".into());
        }
    }
    Ok(Verdict::Passed)
}

fn create_again(ground: &Ground) -> Found {
    let instance = ground.instance()?;
    let second = |place: &str| {
        let made = instance.plugin.create(Kind::Present);
        made.map_err(|status| format!("{place}, create returns {}", status_name(status)))
    };
    let other = second("beside a first instance")?;
    instance.plugin.destroy(other);
    instance.plugin.destroy(instance.number);
    let third = second("after all instances were ended")?;
    instance.plugin.destroy(third);
    Ok(Verdict::Passed)
}

fn poor_host(ground: &Ground) -> Found {
    let instance = ground.instance()?;
    if instance.manifest.needs.is_empty() {
        return Ok(Verdict::Skipped("it says that it needs no table"));
    }
    ground.doing("create with a host without tables");
    match instance.plugin.create(Kind::Poor) {
        Err(_) => Ok(Verdict::Passed),
        Ok(_) => Err("create accepts a host without the tables that the manifest needs".into()),
    }
}
