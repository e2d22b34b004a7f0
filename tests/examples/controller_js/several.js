'use strict';
/* Runs the controllers of several folders in one process. Each says `ready` with its own port, in their order. */
const folders = process.argv.splice(2, Infinity, '0'); // what controller.js reads: any port that is free
const say = console.log;
const next = () => folders.length && require(`${folders.shift()}/controller.js`);
console.log = (line) => {
  say(line);
  next();
};
next();
