//! Outputs of all worlds as they are: those of one length side by side, others as a list per world, for which there must be memory
//! before a thread makes them.

use crate::error::Error;
use crate::memory;
use crate::outputs::{Output, Reading, Rest};
use crate::rows::Rows;
use crate::worlds::Worlds;

const WHAT: &str = "the outputs";
/// What the allocator keeps beside each list.
const OVERHEAD: usize = 16;
/// Lists grow on the threads of workers, for whose sake the allocator takes address space in pieces of this size and becomes
/// very slow when there is none.
const SLACK: usize = 128 << 20;
/// Numbers for which nobody is asked: so few make no difference.
const FEW: usize = 1 << 20;
/// Most contacts of a pair of geoms, and most rows of a contact.
const MOST_OF_A_PAIR: usize = 8;
const MOST_ROWS: usize = 10;

/// An output of all worlds.
pub(crate) enum Column {
    /// As many numbers for each.
    Numbers { values: Vec<f64>, width: usize },
    /// Another number for each.
    Lists(Vec<Vec<f64>>),
}

impl Column {
    fn rows(&mut self) -> Rows<'_> {
        match self {
            Column::Numbers { values, .. } => Rows::F64(values),
            Column::Lists(lists) => Rows::Lists(lists),
        }
    }

    fn of(&self, world: usize) -> &[f64] {
        match self {
            Column::Numbers { values, width } => &values[world * width..][..*width],
            Column::Lists(lists) => &lists[world],
        }
    }
}

impl Worlds {
    /// Computes `outputs` without stepping, no more than they need, and hands each world's to `sink`, in the order of
    /// worlds: world, then one array per output.
    ///
    /// # Errors
    ///
    /// If there is no memory for them.
    pub fn forward(&mut self, outputs: &[Output], sink: &mut dyn FnMut(usize, Vec<Vec<f64>>)) -> Result<(), Error> {
        let columns = self.columns(outputs)?;
        for world in 0..self.nworld() {
            sink(world, columns.iter().map(|column| column.of(world).to_vec()).collect());
        }
        Ok(())
    }

    /// The same, output by output.
    pub(crate) fn columns(&mut self, outputs: &[Output]) -> Result<Vec<Column>, Error> {
        outputs.iter().try_for_each(|output| output.check(self.model()))?;
        let mut columns = outputs.iter().map(|output| self.column(output)).collect::<Result<Vec<_>, _>>()?;
        self.ask_for_lists(outputs, None)?;
        self.engine.read_all(outputs, columns.iter_mut().map(Column::rows).collect(), None);
        Ok(columns)
    }

    /// Room for an output of all worlds.
    fn column(&self, output: &Output) -> Result<Column, Error> {
        let nworld = self.nworld();
        match output.width(self.model()) {
            Some(width) => {
                let values = memory::zeros(WHAT, &[nworld, width], self.options().max_memory)?;
                Ok(Column::Numbers { values, width })
            }
            None => {
                memory::ask(WHAT, &[nworld, size_of::<Vec<f64>>()])?;
                Ok(Column::Lists(vec![Vec::new(); nworld]))
            }
        }
    }

    /// An error if there is no memory for the lists of those of `outputs` that differ in length between worlds: as many numbers as
    /// the worlds, or the chosen ones, have contacts and rows.
    pub(crate) fn ask_for_lists(&mut self, outputs: &[Output], ids: Option<&[usize]>) -> Result<(), Error> {
        let nworld = ids.map_or(self.nworld(), <[usize]>::len);
        let ragged = outputs.iter().filter(|output| output.width(self.model()).is_none());
        let (contacts, rows): (Vec<&Output>, Vec<&Output>) = ragged.partition(|o| o.rest() == Rest::Contact);
        if contacts.is_empty() && rows.is_empty() {
            return Ok(());
        }
        let width =
            |outputs: &[&Output]| outputs.iter().map(|o| o.shape(self.model()).1.iter().product::<usize>()).sum();
        let (per_contact, per_row): (usize, usize) = (width(&contacts), width(&rows));
        let sizes = &self.model().tables().sizes;
        let most = self.options().max_contacts.min(MOST_OF_A_PAIR * sizes.npair);
        let numbers = most * per_contact + (most * MOST_ROWS + sizes.nv + 2 * sizes.njnt) * per_row;
        if nworld.saturating_mul(numbers) <= FEW {
            return Ok(());
        }
        let lists = nworld * (contacts.len() + rows.len()) * (size_of::<Vec<f64>>() + OVERHEAD);
        let limit = self.options().max_memory;
        let mut counts = [memory::zeros(WHAT, &[nworld], limit)?, memory::zeros(WHAT, &[nworld], limit)?];
        let rows = counts.iter_mut().map(|c| Rows::F64(c)).collect();
        self.read(&Reading { names: &["ncon", "nefc"], ids, cancel: None }, rows)?;
        let [ncon, nefc] = counts.map(|c| c.iter().sum::<f64>() as usize);
        let numbers = ncon * per_contact + nefc * per_row;
        let total = numbers.checked_mul(size_of::<f64>()).and_then(|n| n.checked_add(lists));
        let total = total.and_then(|n| n.checked_add(n / 4)?.checked_add(SLACK));
        memory::ask(WHAT, &[total.ok_or(Error::Memory { what: WHAT, bytes: None })?])
    }
}
