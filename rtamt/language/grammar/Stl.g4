/* The specification language.

The rules are LL(1), but for the choice between a declaration and a formula, which takes two tokens.
There is one rule for terms and formulas together, and it is flat: the table in operators.py says
how strongly operators bind and what is a term and what a formula, and the tree is built by it
(expressions.py). So a bracket costs two calls, and no text makes ANTLR look ahead further.

The lexer knows no operator by name. The scanner (tokens.py) gives a NAME or SYMBOL the type of its
row in operators.py, drops the END tokens that are mere white space, and adds one at the end.
*/
grammar Stl;

// By the notation of the row: TEMPORAL and PREFIX stand before an operand, BINDING and INFIX between
// two; an interval may follow TEMPORAL and BINDING. TRUTH is a formula by itself.
tokens { TEMPORAL, PREFIX, BINDING, INFIX, FUNCTION, TRUTH }

specification
    : END* ('specification' name=NAME END+)?
      ( ( imports+=importing
        | annotations+=annotation
        | constants+=constant
        | declarations+=declaration
        | definitions+=definition
        ) END+
      )* EOF
    ;

importing : 'from' module=NAME 'import' names+=NAME (',' names+=NAME)* ;

annotation
    : '@' kind=NAME '(' variable=NAME ',' (location=path | label=STRING (',' link=STRING)?) ')'
    ;

// A word of the language may be part of a path.
path : '/'? part ('/' part)* ;

part
    : NAME | NUMBER | TEMPORAL | PREFIX | BINDING | INFIX | FUNCTION | TRUTH
    | 'inf' | 'const' | 'input' | 'output' | 'specification' | 'from' | 'import'
    ;

constant : 'const' kind=NAME name=NAME '=' default=value ;

// The name before the range is "in", which is no word of the language.
declaration : io=('input' | 'output')? kind=NAME name=NAME (within=NAME bounds=range)? ('=' default=value)? ;

range : '[' lower=limit (':' | ',') upper=limit ']' ;

// A number or the name of a constant.
limit : '-'? (NUMBER | NAME | 'inf') ;

value : '-'? NUMBER ;

definition : (name=NAME '=')? formula=expression ;

expression : operand ((BINDING interval? | INFIX | '-' | '/') operand)* ;

operand
    : (TEMPORAL interval? | PREFIX | '-')*
      ( NAME
      | ELEMENT
      | NUMBER
      | TRUTH
      | '(' expression ')'
      | FUNCTION '(' expression (',' expression)* ')'
      )
    ;

// A round bracket stands only after an open end: [5,) or [5,inf).
interval : '[' bound (':' | ',') (bound (']' | ')') | ')') ;

// A number or the name of a constant; the name after it is a unit.
bound : '-'? (NUMBER | NAME | 'inf') NAME? ;

// Keywords come before NAME: of two rules that match the same text, ANTLR takes the first.
SPECIFICATION : 'specification' ;
FROM : 'from' ;
IMPORT : 'import' ;
CONST : 'const' ;
INPUT : 'input' ;
OUTPUT : 'output' ;
INF : 'inf' ;

// A symbol needs a row in operators.py. '-' is a prefix as well, and paths use '/'.
SYMBOL
    : '!' | '&' | '&&' | '|' | '||' | '->' | '<->'
    | '<' | '<=' | '>' | '>=' | '==' | '!=' | '!==' | '+' | '*'
    ;
MINUS : '-' ;
SLASH : '/' ;

NAME : WORD ('.' WORD)* ;

// An element of a list in a message: scan.ranges[0]. After a word of the language, as in always[5], the
// scanner makes an interval of it.
ELEMENT : NAME INDEX (INDEX | '.' WORD)* ;
STRING : '"' ~["\r\n]* '"' ;
NUMBER : (DIGIT+ ('.' DIGIT*)? | '.' DIGIT+) ([eE] [+-]? DIGIT+)? ;

EQUALS : '=' ;
COLON : ':' ;
COMMA : ',' ;
AT : '@' ;
OPEN : '(' ;
CLOSE : ')' ;
OPEN_INTERVAL : '[' ;
CLOSE_INTERVAL : ']' ;
END : ';' | '\n' ;

COMMENT : ('//' ~'\n'* | '/*' .*? '*/') -> skip ;
SPACE : [ \t\r\f]+ -> skip ;

// What remains is an error; the scanner reports it.
OPEN_COMMENT : '/*' ;
ILLEGAL : . ;

fragment WORD : [A-Za-z_] [A-Za-z_0-9]* ;
fragment DIGIT : [0-9] ;
fragment INDEX : '[' ('0' | [1-9] DIGIT*) ']' ;
