//! The published figures, from a CSV file with the columns table, image, components, method,
//! density_percent, unit and value, the unit `psnr_db` or `seconds`.

use crate::ThesisError;
use crate::cases::{Case, Series};
use crate::csv;
use crate::grid::Unit;
use std::collections::HashMap;

/// A published figure.
#[derive(Clone, Debug, PartialEq)]
pub struct PublishedFigure {
    /// The table that it stands in, such as 4.2a.
    pub table: String,
    /// Name of the picture.
    pub image: String,
    /// Components of the image.
    pub components: usize,
    /// Name of the method.
    pub method: String,
    /// Density in percent.
    pub density: f64,
    /// Its unit, by name.
    pub unit: String,
    /// The figure.
    pub value: f64,
}

/// The published figures, by what they are figures of.
#[derive(Default)]
pub struct Published {
    figures: Vec<PublishedFigure>,
    /// The methods that figures may be of, by components and name.
    methods: HashMap<(usize, String), Series>,
    /// Indices into the figures, by picture, components, code of the case, and unit.
    places: HashMap<(String, usize, String, String), Vec<usize>>,
}

impl Published {
    /// Reads the figures of known methods.
    ///
    /// # Errors
    /// The first line that does not hold a figure; `name` is the file's.
    pub fn read(text: &str, name: &str, known: Vec<Series>) -> Result<Self, ThesisError> {
        let named = |series: Series| ((series.components, series.label.clone()), series);
        let mut published =
            Self { methods: known.into_iter().map(named).collect(), ..Self::default() };
        for (i, line) in text.lines().enumerate() {
            if i == 0 && line.contains("density_percent") || line.trim().is_empty() {
                continue;
            }
            let refused =
                |reason| ThesisError::Published { name: name.to_owned(), line: i + 1, reason };
            published.add(read_line(line).map_err(refused)?);
        }
        Ok(published)
    }

    /// Adds a figure.
    fn add(&mut self, figure: PublishedFigure) {
        if let Some(series) = self.series(&figure) {
            let code = series.case(figure.density).code;
            let place = (figure.image.clone(), figure.components, code, figure.unit.clone());
            self.places.entry(place).or_default().push(self.figures.len());
        }
        self.figures.push(figure);
    }

    /// Every figure, in the order of the file.
    #[must_use]
    pub fn figures(&self) -> &[PublishedFigure] {
        &self.figures
    }

    /// The method that a figure is of, if these tables have it.
    #[must_use]
    pub fn series(&self, figure: &PublishedFigure) -> Option<&Series> {
        self.methods.get(&(figure.components, figure.method.clone()))
    }

    /// The figure of a case: that of this table, else that of another which has the same case,
    /// by this or another name.
    #[must_use]
    pub fn find(&self, table: &str, image: &str, case: &Case, unit: Unit) -> Option<f64> {
        let place = (image.to_owned(), case.components, case.code.clone(), unit.name().to_owned());
        let figures = || self.places.get(&place).into_iter().flatten().map(|&i| &self.figures[i]);
        let own = figures().find(|figure| figure.table == table);
        own.or_else(|| figures().next()).map(|figure| figure.value)
    }
}

/// The figure of a line, or in words why there is none.
fn read_line(line: &str) -> Result<PublishedFigure, &'static str> {
    let fields = csv::split(line).ok_or("a quote is not closed")?;
    let [table, image, components, method, density, unit, value] =
        <[String; 7]>::try_from(fields).map_err(|_| {
            "the fields are not table, image, components, method, density_percent, unit and value"
        })?;
    Ok(PublishedFigure {
        table,
        image,
        components: components.parse().map_err(|_| "the components are not a number")?,
        method,
        density: density.parse().map_err(|_| "the density is not a number")?,
        unit,
        value: value.parse().map_err(|_| "the value is not a number")?,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use pixmesh_meshing::Method;
    use pixmesh_meshing::parameters::{Policy, Startup};

    fn known() -> Vec<Series> {
        vec![Series::method(Method::Med, 3), Series::ed_like(Policy::PsdMaxD, Startup::Mirroring)]
    }

    #[test]
    fn a_figure_is_found_under_every_name_and_first_in_its_own_table() {
        let text = "table,image,components,method,density_percent,unit,value\r\n\
            4.2a,lena,3,MED,0.5,psnr_db,19.2\r\n\
            3.3b,lena,3,\"ED-like PSD(Max,D) mirror\",0.50,psnr_db,19.1\r\n";
        let published = Published::read(text, "figures", known()).unwrap();
        let case = known()[0].case(0.5);
        let find = |table, image| published.find(table, image, &case, Unit::PsnrDb);
        assert_eq!(find("3.3b", "lena"), Some(19.1));
        assert_eq!(find("4.2a", "lena"), Some(19.2));
        assert_eq!(find("4.1", "lena"), Some(19.2));
        assert_eq!(find("4.2a", "kodim23"), None);
        assert_eq!(published.find("4.2a", "lena", &case, Unit::Seconds), None);
    }

    #[test]
    fn a_line_without_a_figure_is_refused_by_its_number() {
        for (line, reason) in [
            ("4.2a,lena,3,MED,0.5,psnr_db", "the fields"),
            ("4.2a,lena,three,MED,0.5,psnr_db,1", "components"),
            ("4.2a,lena,3,MED,0.5,psnr_db,x", "value"),
            ("4.2a,lena,3,\"MED,0.5,psnr_db,1", "quote"),
        ] {
            let text = format!("\n{line}\n");
            let error = Published::read(&text, "figures", known()).err().unwrap().to_string();
            assert!(error.starts_with("figures, line 2: ") && error.contains(reason), "{error}");
        }
    }
}
