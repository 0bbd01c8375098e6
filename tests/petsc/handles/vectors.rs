//! Vectors, and sums over the ranks.

use super::{close, share};
use crate::common::ranks::{Case, case};
use rebond::communicator::Communicator;
use rebond::petsc::{Context, Index, Vector};
use rebond::{Error, Result};

pub const CASES: &[Case] =
    &[case("sums_and_gathers", &[1, 2, 4], sums_and_gathers), case("vectors", &[1, 2, 4], vectors)];

fn sums_and_gathers(arguments: &[String]) -> Result<()> {
    let context = Context::start(arguments)?;
    let (rank, size) = (context.rank(), context.size());
    assert_eq!(context.comm().all_reduce_sum(rank as f64 + 1.0), (size * (size + 1) / 2) as f64);
    assert_eq!(context.comm().all_reduce_max(-(rank as f64)), 0.0);
    let mut pair = [1.0, rank as f64];
    assert_eq!(context.comm().all_reduce_sum_slice(&pair), context.comm().all_reduce_sum(pair));
    context.comm().all_reduce_sum_slice_unordered(&mut pair);
    assert_eq!(pair, [size as f64, (size * (size - 1) / 2) as f64]);
    let comm = context.comm();
    let mut first = [(rank as f64, rank > 0), (-1.0, true)];
    comm.broadcast(&mut first);
    assert_eq!(first, [(0.0, false), (-1.0, true)]);
    let (all, offset) = comm.all_gather_with_offset(&vec![[rank as u64; 2]; rank]);
    let expected: Vec<_> = (0..size).flat_map(|r| vec![[r as u64; 2]; r]).collect();
    assert_eq!((all, offset), (expected, rank * rank.saturating_sub(1) / 2));
    let ranks: Vec<_> = (0..size).map(|r| (r, r % 2 == 0)).collect();
    assert_eq!(comm.all_gather_one((rank, rank % 2 == 0)), ranks);
    let parts: Vec<_> = (0..size).map(|r| vec![r as u8; r]).collect();
    assert_eq!(comm.gather(&vec![rank as u8; rank]), if rank == 0 { parts } else { Vec::new() });
    assert!(comm.all_reduce_max(if rank == 0 { f64::NAN } else { 1.0 }).is_infinite());
    // Rounding tells the order: rank by rank, the small terms are lost one after the other.
    let term = if rank == 0 { 1.0 } else { f64::EPSILON / 2.0 };
    assert_eq!(comm.all_reduce_sum(term), 1.0);
    assert!(comm.all_reduce_all(true) && !comm.all_reduce_all(rank != size - 1));
    assert!(comm.all_reduce_any(rank == size - 1) && !comm.all_reduce_any(false));
    match comm.all_ok(if rank == size - 1 { Err(Error::Usage("the last".into())) } else { Ok(rank) }) {
        Err(error) => assert_eq!((error.to_string().as_str(), error.exit_code()), ("the last", 2)),
        Ok(rank) => panic!("rank {rank} goes on"),
    }
    context.comm().barrier();
    Ok(())
}

fn vectors(arguments: &[String]) -> Result<()> {
    let context = Context::start(arguments)?;
    let range = share(&context, 100);
    let values: Vec<f64> = range.clone().map(|i| i as f64).collect();
    let mut x = Vector::new(&context, values.len())?;
    x.set_local(&values)?;
    assert_eq!(x.local_size(), values.len());
    assert_eq!(x.range(), range.start as Index..range.end as Index);
    let mut y = x.duplicate()?;
    assert_eq!(y.dot(&y)?, 0.0);
    y.fill(2.0)?;
    assert_eq!(x.dot(&y)?, 9900.0);
    close(x.dot(&x)?, 328_350.0, 1e-15);
    y.add_scaled(-1.0, &x)?;
    y.scale(3.0)?;
    assert_eq!(y.to_vec()?, values.iter().map(|x| 6.0 - 3.0 * x).collect::<Vec<_>>());
    let mut copy = vec![0.0; values.len()];
    x.copy_to(&mut copy)?;
    assert_eq!(copy, values);
    Ok(())
}
