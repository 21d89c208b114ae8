//! Splits a scene file into tokens, as a stream.
//!
//! A file is read through one buffer and never held as a whole. Single tokens ([`Lexer::next_token`]) serve
//! directives; arrays of numbers, which are nearly all of a big file, are parsed straight into a vector
//! ([`Lexer::next_value`] yields borrowed bytes).

use std::io::Read;

use super::error::{FileId, Place, Problem, Result, Span};

/// Bytes read at once.
const BUFFER: usize = 1 << 18;

/// Longest token. Longer ones are binary rubbish, and would have to be held in memory.
const MAX_TOKEN: usize = 1 << 16;

/// Windows' editors put it before UTF-8 text.
const BYTE_ORDER_MARK: &[u8] = b"\xef\xbb\xbf";

/// What a token is.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum TokenKind {
    /// A bare word or a number.
    Word(String),
    /// A quoted string, escapes resolved.
    Quoted(String),
    LeftBracket,
    RightBracket,
    /// The file is over.
    End,
}

/// A token and its place.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Token {
    pub kind: TokenKind,
    pub span: Span,
}

impl Token {
    /// How to speak of it in a message.
    pub(crate) fn describe(&self) -> String {
        match &self.kind {
            TokenKind::Word(word) => format!("`{}`", shorten(word)),
            TokenKind::Quoted(text) => format!("\"{}\"", shorten(text)),
            TokenKind::LeftBracket => "`[`".into(),
            TokenKind::RightBracket => "`]`".into(),
            TokenKind::End => "the end of the file".into(),
        }
    }
}

/// Cuts a text of unknown length and content to what fits into a message.
pub(crate) fn shorten(text: &str) -> String {
    const LONGEST: usize = 60;
    let text: String = text.chars().map(|c| if c.is_control() { '\u{fffd}' } else { c }).collect();
    if text.chars().count() <= LONGEST {
        return text;
    }
    text.chars().take(LONGEST).chain("...".chars()).collect()
}

/// A raw token: its form, and where its bytes are in the buffer.
#[derive(Clone, Copy, PartialEq)]
enum Form {
    Word,
    Quoted,
    Left,
    Right,
    End,
}

/// Tokens of one file.
pub(crate) struct Lexer {
    file: FileId,
    reader: Box<dyn Read>,
    buffer: Vec<u8>,
    /// Next unread byte of `buffer`.
    position: usize,
    /// Bytes of `buffer` that hold data.
    filled: usize,
    /// Offset in the file of `buffer[0]`.
    base: u64,
    line: u32,
    line_start: u64,
    /// Offset behind the last carriage return: a line feed there belongs to it.
    behind_return: u64,
    exhausted: bool,
    peeked: Option<Token>,
}

fn is_space(byte: u8) -> bool {
    matches!(byte, b' ' | b'\n' | b'\t' | b'\r')
}

fn ends_word(byte: u8) -> bool {
    matches!(byte, b' ' | b'\n' | b'\t' | b'\r' | b'"' | b'[' | b']' | b'#')
}

impl Lexer {
    pub(crate) fn new(file: FileId, reader: Box<dyn Read>) -> Lexer {
        Lexer {
            file,
            reader,
            buffer: vec![0; BUFFER],
            position: 0,
            filled: 0,
            base: 0,
            line: 1,
            line_start: 0,
            behind_return: 0,
            exhausted: false,
            peeked: None,
        }
    }

    /// A lexer in the middle of a file: `reader` stands at the first byte of `span`.
    pub(crate) fn resume(span: Span, reader: Box<dyn Read>) -> Lexer {
        let mut lexer = Lexer::new(span.file, reader);
        lexer.base = span.start;
        lexer.line = span.line;
        lexer.line_start = span.line_start;
        lexer
    }

    /// A span of the bytes `[start, end)` of the buffer, on the present line.
    fn span(&self, start: usize, end: usize) -> Span {
        Span {
            file: self.file,
            line: self.line,
            line_start: self.line_start,
            start: self.base + start as u64,
            end: self.base + end as u64,
        }
    }

    /// Reads more, keeping the bytes from `position` on, which move to the buffer's front.
    /// Returns whether there was more.
    fn refill(&mut self) -> Result<bool> {
        if self.exhausted {
            return Ok(false);
        }
        self.buffer.copy_within(self.position..self.filled, 0);
        self.base += self.position as u64;
        self.filled -= self.position;
        self.position = 0;
        if self.filled >= MAX_TOKEN {
            let span = self.span(0, self.filled.min(32));
            return Err(
                Problem::at(span, "token too long").label(format!("expected at most {MAX_TOKEN} bytes"))
            );
        }
        loop {
            match self.reader.read(&mut self.buffer[self.filled..]) {
                Ok(0) => {
                    self.exhausted = true;
                    return Ok(false);
                }
                Ok(count) => {
                    self.filled += count;
                    return Ok(true);
                }
                Err(error) if error.kind() == std::io::ErrorKind::Interrupted => {}
                Err(error) => {
                    let span = self.span(0, 1);
                    return Err(Problem::at(span, format!("cannot read on: {error}")));
                }
            }
        }
    }

    /// Takes the byte that ends a line: a line feed, a carriage return, or both together.
    fn newline(&mut self, byte: u8) {
        let at = self.base + self.position as u64;
        self.position += 1;
        let second_half = byte == b'\n' && at > 0 && at == self.behind_return;
        if !second_half {
            // Four thousand million lines are not a scene; the number then stays where it is.
            self.line = self.line.saturating_add(1);
        }
        if byte == b'\r' {
            self.behind_return = at + 1;
        }
        self.line_start = at + 1;
    }

    fn skip_space_and_comments(&mut self) -> Result<()> {
        let mut in_comment = false;
        loop {
            while self.position < self.filled {
                let byte = self.buffer[self.position];
                if matches!(byte, b'\n' | b'\r') {
                    in_comment = false;
                    self.newline(byte);
                } else if in_comment || is_space(byte) {
                    self.position += 1;
                } else if byte == b'#' {
                    in_comment = true;
                } else {
                    return Ok(());
                }
            }
            if !self.refill()? {
                return Ok(());
            }
        }
    }

    /// The next token as a range of the buffer. `position` moves behind it.
    fn scan(&mut self) -> Result<(Form, usize, usize)> {
        self.skip_space_and_comments()?;
        let at_start = self.base + self.position as u64 == 0;
        if at_start && self.buffer[..self.filled].starts_with(BYTE_ORDER_MARK) {
            self.position += BYTE_ORDER_MARK.len();
            self.skip_space_and_comments()?;
        }
        if self.position == self.filled {
            return Ok((Form::End, self.position, self.position));
        }
        let start = self.position;
        match self.buffer[start] {
            b'[' => {
                self.position += 1;
                Ok((Form::Left, start, start + 1))
            }
            b']' => {
                self.position += 1;
                Ok((Form::Right, start, start + 1))
            }
            b'"' => self.scan_quoted(),
            _ => self.scan_word(),
        }
    }

    /// While a token is scanned, `position` stays at its first byte, so that a refill keeps it.
    fn scan_word(&mut self) -> Result<(Form, usize, usize)> {
        let mut length = 0;
        loop {
            let rest = &self.buffer[self.position + length..self.filled];
            if let Some(end) = rest.iter().position(|&b| ends_word(b)) {
                length += end;
                break;
            }
            length += rest.len();
            if !self.refill()? {
                break;
            }
        }
        let start = self.position;
        self.position += length;
        Ok((Form::Word, start, self.position))
    }

    fn scan_quoted(&mut self) -> Result<(Form, usize, usize)> {
        let mut length = 1;
        let mut escaped = false;
        loop {
            while self.position + length < self.filled {
                let byte = self.buffer[self.position + length];
                if matches!(byte, b'\n' | b'\r') {
                    return Err(self.unterminated(length));
                }
                length += 1;
                if byte == b'"' && !escaped {
                    let start = self.position;
                    self.position += length;
                    return Ok((Form::Quoted, start, self.position));
                }
                escaped = byte == b'\\' && !escaped;
            }
            if !self.refill()? {
                return Err(self.unterminated(length));
            }
        }
    }

    fn unterminated(&self, length: usize) -> Box<Problem> {
        Problem::at(self.span(self.position, self.position + length), "string without an end")
            .label("expected a closing `\"` on this line")
    }

    /// The next token, owned.
    pub(crate) fn next_token(&mut self) -> Result<Token> {
        if let Some(token) = self.peeked.take() {
            return Ok(token);
        }
        let (form, start, end) = self.scan()?;
        let span = self.span(start, end);
        let kind = match form {
            Form::Word => TokenKind::Word(self.text(start, end)?.to_string()),
            Form::Quoted => TokenKind::Quoted(unescape(self.text(start + 1, end - 1)?, span)?),
            Form::Left => TokenKind::LeftBracket,
            Form::Right => TokenKind::RightBracket,
            Form::End => TokenKind::End,
        };
        Ok(Token { kind, span })
    }

    /// The next token, which stays the next one.
    pub(crate) fn peek(&mut self) -> Result<&Token> {
        if self.peeked.is_none() {
            self.peeked = Some(self.next_token()?);
        }
        Ok(self.peeked.as_ref().expect("just set"))
    }

    /// The next value inside brackets without copying it: a bare word's bytes, or `None` at the closing bracket.
    /// Anything else is returned as a token for the caller to complain about.
    pub(crate) fn next_value(&mut self) -> Result<Value<'_>> {
        debug_assert!(self.peeked.is_none(), "values are read behind a bracket that was taken");
        let (form, start, end) = self.scan()?;
        let span = self.span(start, end);
        match form {
            Form::Word => Ok(Value::Word(&self.buffer[start..end], span)),
            Form::Right => Ok(Value::Close),
            Form::Quoted => {
                let text = unescape(self.text(start + 1, end - 1)?, span)?;
                Ok(Value::Other(Token { kind: TokenKind::Quoted(text), span }))
            }
            Form::Left => Ok(Value::Other(Token { kind: TokenKind::LeftBracket, span })),
            Form::End => Ok(Value::Other(Token { kind: TokenKind::End, span })),
        }
    }

    fn text(&self, start: usize, end: usize) -> Result<&str> {
        std::str::from_utf8(&self.buffer[start..end]).map_err(|error| {
            let at = start + error.valid_up_to();
            Problem::at(self.span(at, at + 1), "this is not UTF-8 text")
                .label("expected a text file in UTF-8")
        })
    }

    /// Span of the value of this index behind the bracket at which the lexer stands (or of the single value).
    pub(crate) fn nth_value(&mut self, index: usize) -> Option<Span> {
        let (form, start, end) = self.scan().ok()?;
        if form != Form::Left {
            return Some(self.span(start, end));
        }
        for i in 0.. {
            let (form, start, end) = self.scan().ok()?;
            match form {
                Form::Right | Form::End => return None,
                _ if i == index => return Some(self.span(start, end)),
                _ => {}
            }
        }
        None
    }
}

/// What [`Lexer::next_value`] found.
pub(crate) enum Value<'a> {
    Word(&'a [u8], Span),
    Close,
    Other(Token),
}

fn unescape(text: &str, span: Span) -> Result<String> {
    if !text.contains('\\') {
        return Ok(text.to_string());
    }
    let mut result = String::with_capacity(text.len());
    let mut characters = text.chars();
    while let Some(c) = characters.next() {
        if c != '\\' {
            result.push(c);
            continue;
        }
        result.push(match characters.next() {
            Some('n') => '\n',
            Some('t') => '\t',
            Some('r') => '\r',
            Some('b') => '\u{8}',
            Some('f') => '\u{c}',
            Some(c @ ('\\' | '\'' | '"')) => c,
            other => {
                let found = other.map(String::from).unwrap_or_default();
                return Err(Problem::new(
                    Place::Span(span),
                    format!("unknown escape `\\{found}` in a string"),
                )
                .label("expected one of \\n \\t \\r \\b \\f \\\\ \\' \\\""));
            }
        });
    }
    Ok(result)
}

/// A finite number. `None`: not a number at all. Decimal notation only (no `inf`, `nan`, hexadecimal).
pub(crate) fn parse_number(bytes: &[u8]) -> Option<f64> {
    let looks_numeric = bytes.iter().all(|b| matches!(b, b'0'..=b'9' | b'+' | b'-' | b'.' | b'e' | b'E'));
    if !looks_numeric {
        return None;
    }
    std::str::from_utf8(bytes).ok()?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pbrt::source::Sources;

    fn tokens(text: &str) -> Vec<TokenKind> {
        let mut lexer = Sources::default().open_text("t", text.as_bytes());
        let mut kinds = Vec::new();
        loop {
            match lexer.next_token().unwrap().kind {
                TokenKind::End => return kinds,
                kind => kinds.push(kind),
            }
        }
    }

    /// Hands out one byte at a time, so that every token straddles a refill.
    struct Trickle(Vec<u8>, usize);

    impl Read for Trickle {
        fn read(&mut self, out: &mut [u8]) -> std::io::Result<usize> {
            let Some(&byte) = self.0.get(self.1) else {
                return Ok(0);
            };
            out[0] = byte;
            self.1 += 1;
            Ok(1)
        }
    }

    #[test]
    fn splits_words_strings_brackets_and_comments() {
        let expected = [
            TokenKind::Word("Shape".into()),
            TokenKind::Quoted("a\"b\\".into()),
            TokenKind::LeftBracket,
            TokenKind::Word("1".into()),
            TokenKind::Word("-2e3".into()),
            TokenKind::RightBracket,
            TokenKind::Quoted("x".into()),
        ];
        let text = "# c \"[\r\nShape\t\"a\\\"b\\\\\"[1 -2e3]# end\n\"x\"#";
        assert_eq!(tokens(text), expected);
        let mut lexer = Lexer::new(FileId(0), Box::new(Trickle(text.as_bytes().to_vec(), 0)));
        for kind in expected {
            assert_eq!(lexer.next_token().unwrap().kind, kind);
        }
    }

    #[test]
    fn spans_are_lines_and_bytes() {
        let mut lexer = Lexer::new(FileId(0), Box::new(Trickle(b"ab\n  \"cd\" e".to_vec(), 0)));
        lexer.next_token().unwrap();
        let span = lexer.next_token().unwrap().span;
        assert_eq!((span.line, span.line_start, span.start, span.end), (2, 3, 5, 9));
        let span = lexer.next_token().unwrap().span;
        assert_eq!((span.line, span.start, span.end), (2, 10, 11));
    }

    #[test]
    fn carriage_returns_end_comments_and_lines() {
        for end in ["\n", "\r", "\r\n"] {
            let text = format!("# one{end}a # two{end}{end} b");
            let mut lexer = Lexer::new(FileId(0), Box::new(Trickle(text.into_bytes(), 0)));
            for (word, line) in [("a", 2), ("b", 4)] {
                let token = lexer.next_token().unwrap();
                assert_eq!((token.kind, token.span.line), (TokenKind::Word(word.into()), line), "{end:?}");
            }
        }
    }

    #[test]
    fn numbers_are_decimal_and_finite_forms_only() {
        assert_eq!(parse_number(b"-.5e1"), Some(-5.0));
        assert_eq!(parse_number(b"1."), Some(1.0));
        for bad in ["inf", "nan", "0x10", "1e", "--1", "1.2.3", "", "+", "true"] {
            assert_eq!(parse_number(bad.as_bytes()), None, "{bad}");
        }
        assert_eq!(parse_number(b"1e400"), Some(f64::INFINITY));
    }

    #[test]
    fn endless_tokens_are_refused() {
        let text = vec![b'a'; 3 * MAX_TOKEN];
        let mut lexer = Lexer::new(FileId(0), Box::new(Trickle(text.clone(), 0)));
        assert!(lexer.next_token().is_err());
        let mut quoted = vec![b'"'];
        quoted.extend(text);
        let mut lexer = Lexer::new(FileId(0), Box::new(Trickle(quoted, 0)));
        assert!(lexer.next_token().is_err());
    }
}
